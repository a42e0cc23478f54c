/* ---------------------------------------------------------------------------------------------------------------------------- what is called */
#define SETTABLE (@UPPER@_INPUTS + @UPPER@_PARAMETERS)

void @NAME@_start(@NAME@_machine *w) {
  int i;
  @NAME@_copy_start(w);
  for (i = 0; i < SETTABLE; ++i) w->wanted[i] = w->p[@NAME@_places[i]];
}

int @NAME@_set(@NAME@_machine *w, int number, double value) {
  double before;
  if (number < 0 || number >= SETTABLE) return @UPPER@_UNKNOWN;
  before = w->wanted[number];
  w->wanted[number] = value;
  if (!@NAME@_allowed(w->wanted)) {
    w->wanted[number] = before;
    return @UPPER@_OUTSIDE;
  }
  if (w->ints[AT_STARTED] == 0) w->p[@NAME@_places[number]] = value;
  return @UPPER@_DONE;
}

int @NAME@_set_state(@NAME@_machine *w, int state, double value) {
  if (state < 0 || state >= @UPPER@_STATES || w->ints[AT_STARTED] != 0) return @UPPER@_UNKNOWN;
  if (!isfinite(value)) return @UPPER@_OUTSIDE;
  w->x[state] = value;
  return @UPPER@_DONE;
}

/* What the caller has set becomes the next jump, in the place of those that are over. */
static void @NAME@_jump(@NAME@_machine *w) {
  int i;
  int64_t end, entry;
  end = w->jump_first[w->ints[AT_JUMP]];
  entry = end;
  for (i = 0; i < SETTABLE; ++i) {
    if (w->wanted[i] != w->p[@NAME@_places[i]]) {
      --entry;
      w->jump_index[entry] = @NAME@_places[i];
      w->jump_value[entry] = w->wanted[i];
    }
  }
  if (entry == end) return;
  --w->ints[AT_JUMP];
  w->jump_first[w->ints[AT_JUMP]] = entry;
  w->jump_t[w->ints[AT_JUMP]] = w->reals[AT_TIME];
}

/* Switches of the second direction of a friction go with those of the first. */
static void @NAME@_sift(@NAME@_machine *w) {
  int64_t e, kept = 0;
  for (e = 0; e < w->ints[AT_EVENTS]; ++e) {
    if (@NAME@_second[w->ev_i[e]]) continue;
    w->ev_t[kept] = w->ev_t[e];
    w->ev_i[kept] = w->ev_i[e];
    w->ev_m[3 * kept] = w->ev_m[3 * e];
    w->ev_m[3 * kept + 1] = w->ev_m[3 * e + 1];
    ++kept;
  }
  w->ints[AT_EVENTS] = kept;
}

int @NAME@_step(@NAME@_machine *w, double until) {
  int status;
  if (!isfinite(until) || until < w->reals[AT_TIME]) return @UPPER@_BACKWARD;
  w->ints[AT_EVENTS] = 0;
  w->reals[AT_END] = until;
  if (w->ints[AT_STARTED] != 0) @NAME@_jump(w);
  status = (int)loop_advance(w);
  @NAME@_sift(w);
  return status == AT_EVENTS_FULL ? @UPPER@_OVERRUN : status;
}

double @NAME@_time(const @NAME@_machine *w) {
  return w->reals[AT_TIME];
}

void @NAME@_outputs(const @NAME@_machine *w, double *y) {
  @NAME@_model_signals(w->reals[AT_TIME], 0.0, w->x, w->k, w->p, w->m, y);
}

int @NAME@_mode(const @NAME@_machine *w, int element) {
  return element >= 0 && element < @UPPER@_ELEMENTS ? (int)w->m[element] : @UPPER@_UNKNOWN;
}

int @NAME@_events(const @NAME@_machine *w) {
  return (int)w->ints[AT_EVENTS];
}

double @NAME@_event(const @NAME@_machine *w, int event, int *element, int *before, int *after) {
  if (event < 0 || event >= w->ints[AT_EVENTS]) return -1.0;
  *element = (int)w->ev_i[event];
  *before = w->ev_m[3 * event];
  *after = w->ev_m[3 * event + 1];
  return w->ev_t[event];
}

int @NAME@_culprit(const @NAME@_machine *w) {
  return (int)w->ints[AT_CULPRIT];
}

const char *@NAME@_culprit_name(const @NAME@_machine *w, int status) {
  const int64_t which = w->ints[AT_CULPRIT];
  int i;
  if (status == @UPPER@_NEGATIVE_BOUND) return @NAME@_element_name((int)which);
  if (status != @UPPER@_NOT_FINITE) return 0;
  for (i = @NAME@_first_value[which]; i < @NAME@_first_value[which + 1] - 1; ++i) {
    if (!isfinite(w->z[i - @NAME@_first_value[which]])) break;
  }
  return @NAME@_value_names[i];
}

int64_t @NAME@_engine_steps(const @NAME@_machine *w) {
  return w->ints[AT_ACCEPTED] + w->ints[AT_REJECTED];
}

const char *@NAME@_settable_name(int number) {
  return number >= 0 && number < SETTABLE ? @NAME@_settable_names[number] : 0;
}

const char *@NAME@_output_name(int output) {
  return output >= 0 && output < @UPPER@_OUTPUTS ? @NAME@_output_names[output] : 0;
}

const char *@NAME@_element_name(int element) {
  return element >= 0 && element < @UPPER@_ELEMENTS ? @NAME@_element_names[element] : 0;
}

const char *@NAME@_mode_name(int element, int mode) {
  return @NAME@_mode_word(element, mode);
}

const char *@NAME@_status_text(int status) {
  switch (status) {
    case @UPPER@_DONE: return "done";
    case @UPPER@_OVERRUN: return "the call has made all the steps or switches that it may: call again to go on";
    case @UPPER@_ENDLESS: return "switching has no end";
    case @UPPER@_UNDERFLOW: return "the steps have become too short";
    case @UPPER@_INCONSISTENT: return "no modes are consistent";
    case @UPPER@_NEGATIVE_BOUND: return "the bound of a friction is negative: is its load?";
    case @UPPER@_NOT_FINITE: return "a controller gives a command, or remembers a value, that is no finite number";
    case @UPPER@_STATE_NOT_FINITE: return "a state is no finite number";
    case @UPPER@_STALLED: return "a million steps have hardly moved the time";
    case @UPPER@_BACKWARD: return "the time asked for lies before the present one, or is no number";
    case @UPPER@_UNKNOWN: return "there is no such number, or it cannot be set now";
    case @UPPER@_OUTSIDE: return "the value is not finite, out of bounds, or not allowed beside the others";
    default: return "unknown";
  }
}
