#ifdef __cplusplus
extern "C" {
#endif

/* Begin anew, with the start state, inputs and parameters of the export. Call it first. */
void @NAME@_start(@NAME@ *w);

/* Set an input or a parameter by its number. Before the first step it is there from the start; later it acts from the next step on, as a jump. */
int @NAME@_set(@NAME@ *w, int number, double value);

/* Set a state, before the first step only. */
int @NAME@_set_state(@NAME@ *w, int state, double value);

/* Go on to a time [s], which may be the present one. Every switch on the way is located. Returns @UPPER@_DONE, or what is in the way. */
int @NAME@_step(@NAME@ *w, double until);

/* The present time [s]; all outputs; the mode of an element. After the first step. */
double @NAME@_time(const @NAME@ *w);
void @NAME@_outputs(const @NAME@ *w, double *y);
int @NAME@_mode(const @NAME@ *w, int element);

/* The switches of the last step: how many, and each of them. */
int @NAME@_events(const @NAME@ *w);
double @NAME@_event(const @NAME@ *w, int event, int *element, int *before, int *after);

/* Steps of the engine since the start. */
int64_t @NAME@_engine_steps(const @NAME@ *w);

/* Names, 0 where there is none. */
const char *@NAME@_settable_name(int number);
const char *@NAME@_output_name(int output);
const char *@NAME@_element_name(int element);
const char *@NAME@_mode_name(int element, int mode);
const char *@NAME@_status_text(int status);

#ifdef __cplusplus
}
#endif
