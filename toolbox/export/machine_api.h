#ifdef __cplusplus
extern "C" {
#endif

/* Begin anew, with the start state, inputs and parameters of the export. Call it first. */
void @NAME@_start(@NAME@_machine *w);

/* Set an input or a parameter by its number. Before the first step it is there from the start; later it acts from the next step on, as a jump.
   Returns @UPPER@_DONE, or @UPPER@_UNKNOWN or @UPPER@_OUTSIDE, which change nothing. What is refused in Python is refused here. */
int @NAME@_set(@NAME@_machine *w, int number, double value);

/* Set a state, before the first step only. */
int @NAME@_set_state(@NAME@_machine *w, int state, double value);

/* Go on to a time [s], which may be the present one. Every switch on the way is located. Returns @UPPER@_DONE, or what is in the way. */
int @NAME@_step(@NAME@_machine *w, double until);

/* The present time [s]; all outputs; the mode of an element. After the first step. */
double @NAME@_time(const @NAME@_machine *w);
void @NAME@_outputs(const @NAME@_machine *w, double *y);
int @NAME@_mode(const @NAME@_machine *w, int element);

/* The switches of the last step: how many, and each of them. */
int @NAME@_events(const @NAME@_machine *w);
double @NAME@_event(const @NAME@_machine *w, int event, int *element, int *before, int *after);

/* The friction whose bound is negative, after @UPPER@_NEGATIVE_BOUND, or the controller whose value is no finite number, after @UPPER@_NOT_FINITE:
   its number, and the name of the friction, or of the value and its controller; 0 after any other status. */
int @NAME@_culprit(const @NAME@_machine *w);
const char *@NAME@_culprit_name(const @NAME@_machine *w, int status);

/* Steps of the engine since the start. */
int64_t @NAME@_engine_steps(const @NAME@_machine *w);

/* Names, 0 where there is none. */
const char *@NAME@_settable_name(int number);
const char *@NAME@_output_name(int output);
const char *@NAME@_element_name(int element);
const char *@NAME@_mode_name(int element, int mode);
const char *@NAME@_status_text(int status);

#ifdef __cplusplus
}
#endif
