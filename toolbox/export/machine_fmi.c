/* The machine of @NAME@.c behind FMI: an instance, its variables by number, its steps, its event mode. The interface of one version stands below. */
#include <stdio.h>
#include <stdlib.h>
#include "@NAME@.c"

/* References: time is 0; then settable numbers, states, their derivatives, outputs that are no states, indicators, modes. */
#define SETTABLES (@UPPER@_INPUTS + @UPPER@_PARAMETERS)
#define STATES @UPPER@_STATES /* those with names; hidden ones behind them */
#define FIRST_STATE (1 + SETTABLES)
#define FIRST_RATE (FIRST_STATE + INTEGRATED)
#define FIRST_OUTPUT (FIRST_RATE + INTEGRATED)
#define FIRST_INDICATOR (FIRST_OUTPUT + @UPPER@_OUTPUTS - STATES)
#define FIRST_MODE (FIRST_INDICATOR + INDICATORS)
#define FIELD_SIZE (2 * INTEGRATED + 2 * GUARDS + 1)
#define CALLS 1000 /* that one communication step may take */

typedef enum { MADE, STARTING, STEPPING, EVENT, CONTINUOUS, ENDED } Phase;
typedef struct {
  @NAME@_machine machine, ahead; /* ahead: what the machine shows once all that is due now has happened */
  double start, last, field[FIELD_SIZE];
  int exchange, early, events_used, fresh, entered;
  enum { CURRENT, STALE, AHEAD } shown;
  Phase phase;
  Teller teller;
  char name[128];
} Unit;

static void tell(const Teller *teller, const char *name, Status status, const char *message);

static int refused(Unit *u, const char *message) {
  if (u) tell(&u->teller, u->name, ERROR, message);
  return 0;
}

/* Tells why the machine cannot go on: the contact, where it is one, and the time. */
static int stopped(Unit *u, const @NAME@_machine *w, int status) {
  char words[512];
  const double t = u->start + w->reals[AT_TIME];
  const char *name = @NAME@_culprit_name(w, status);
  if (name) snprintf(words, sizeof words, "`%.300s` at t = %.9g s: %s", name, t, @NAME@_status_text(status));
  else snprintf(words, sizeof words, "at t = %.9g s: %s", t, @NAME@_status_text(status));
  return refused(u, words);
}

static void begin(Unit *u) {
  @NAME@_start(&u->machine);
  u->start = u->last = 0.0;
  u->phase = MADE;
  u->shown = STALE;
  u->fresh = u->entered = 0;
}

static Unit *instance(const char *name, int exchange, int early, int events_used, const Teller *teller) {
  Unit *u = (Unit *)calloc(1, sizeof(Unit));
  if (!u) return 0;
  u->teller = *teller;
  if (name) strncpy(u->name, name, sizeof u->name - 1);
  u->exchange = exchange;
  u->early = early;
  u->events_used = events_used;
  begin(u);
  return u;
}

/* The machine as it shows itself: samples and jumps of the present instant are already in its outputs. */
static const @NAME@_machine *seen(Unit *u) {
  if (u->shown == STALE) {
    int status, i;
    @NAME@_machine *w = &u->ahead;
    *w = u->machine;
    status = @NAME@_step(w, w->reals[AT_TIME]);
    if (status == @UPPER@_DONE && SAMPLERS > 0) {
      const double now = w->reals[AT_TIME];
      double x[INTEGRATED + 1];
      for (i = 0; i < INTEGRATED; ++i) x[i] = w->x[i];
      status = @NAME@_step(w, now + fmax(1e-12, 1e-13 * fabs(now)));
      for (i = 0; i < INTEGRATED; ++i) w->x[i] = x[i];
      w->reals[AT_TIME] = now;
    }
    if (status != @UPPER@_DONE) {
      stopped(u, w, status);
      return 0;
    }
    u->shown = AHEAD;
  }
  return u->shown == AHEAD ? &u->ahead : &u->machine;
}

static const double *field_of(Unit *u, const @NAME@_machine *w) {
  if (!u->fresh) @NAME@_model_field(w->reals[AT_TIME], 0.0, w->x, w->k, w->p, w->m, u->field);
  u->fresh = 1;
  return u->field + INTEGRATED;
}

static double indicator(Unit *u, const @NAME@_machine *w, int i) {
  const double *field = field_of(u, w);
  const int j = indicator_guard[i];
  if (indicator_rate[i]) return w->side[j] * field[INTEGRATED + GUARDS + j];
  return w->side[j] * field[INTEGRATED + j] + (w->armed[j] ? 0.0 : UNARMED * w->guard_scale[w->slot[j]] + 1e-300);
}

static int get_reals(Unit *u, const unsigned int *r, size_t n, double *value) {
  const @NAME@_machine *w = u->exchange && u->phase >= EVENT ? &u->machine : seen(u);
  double y[@UPPER@_OUTPUTS + 1];
  int known = 0;
  size_t k;
  if (!w) return 0;
  if (!u->exchange || u->phase < EVENT) u->fresh = 0;
  for (k = 0; k < n; ++k) {
    const long i = (long)r[k];
    if (i == 0) value[k] = u->start + w->reals[AT_TIME];
    else if (i < FIRST_STATE) value[k] = u->machine.wanted[i - 1];
    else if (i < FIRST_RATE) value[k] = w->x[i - FIRST_STATE];
    else if (i < FIRST_OUTPUT) value[k] = field_of(u, w)[i - FIRST_RATE];
    else if (i < FIRST_INDICATOR) {
      if (!known) @NAME@_outputs(w, y);
      known = 1;
      value[k] = y[STATES + i - FIRST_OUTPUT];
    } else if (i < FIRST_MODE) value[k] = indicator(u, w, (int)(i - FIRST_INDICATOR));
    else return refused(u, "a number is asked for by a reference that is none of this unit");
  }
  return 1;
}

/* Sets all of these numbers, or, where one is refused, none. */
static int set_reals(Unit *u, const unsigned int *r, size_t n, const double *value) {
  @NAME@_machine *w = &u->machine;
  double wanted[SETTABLES + 1];
  size_t k;
  memcpy(wanted, w->wanted, SETTABLES * sizeof *wanted);
  for (k = 0; k < n; ++k) {
    const long i = (long)r[k];
    if (i > 0 && i < FIRST_STATE) {
      if (u->phase == CONTINUOUS && i > @UPPER@_INPUTS) return refused(u, "a parameter is to be set in event mode, or between communication steps");
      wanted[i - 1] = value[k];
    } else if (i < FIRST_STATE || i >= FIRST_STATE + STATES || u->phase > STARTING || !isfinite(value[k])) {
      return refused(u, "only inputs, parameters, and before the first step states can be set, to finite numbers");
    }
  }
  if (!@NAME@_allowed(wanted)) return refused(u, "inputs and parameters must be finite, within their bounds, and allowed beside one another");
  for (k = 0; k < n; ++k) {
    const long i = (long)r[k];
    if (i < FIRST_STATE) {
      w->wanted[i - 1] = value[k];
      if (w->ints[AT_STARTED] == 0 || u->phase == CONTINUOUS) w->p[@NAME@_places[i - 1]] = value[k];
    } else {
      @NAME@_set_state(w, (int)(i - FIRST_STATE), value[k]);
    }
  }
  u->fresh = 0;
  if (!u->exchange || u->phase <= STARTING) u->shown = STALE;
  return 1;
}

static int get_modes(Unit *u, const unsigned int *r, size_t n, int32_t *value) {
  const @NAME@_machine *w = u->exchange && u->phase >= EVENT ? &u->machine : seen(u);
  size_t k;
  if (!w) return 0;
  for (k = 0; k < n; ++k) {
    const long i = (long)r[k] - FIRST_MODE;
    if (i < 0 || i >= @UPPER@_ELEMENTS) return refused(u, "a mode is asked for by a reference that is none of this unit");
    value[k] = (int32_t)w->m[i];
  }
  return 1;
}

static int initialised(Unit *u) {
  const int status = @NAME@_step(&u->machine, 0.0);
  if (status != @UPPER@_DONE) return stopped(u, &u->machine, status);
  u->phase = u->exchange ? EVENT : STEPPING;
  u->shown = u->exchange || SAMPLERS == 0 ? CURRENT : STALE;
  u->fresh = u->entered = 0;
  if (u->exchange) u->machine.reals[AT_END] = INFINITY;
  return 1;
}

/* One communication step of length h from time t, the present one, or with `stop` to the first switch before it. 1: it is there; 2: a switch on the way; 0: refused. */
static int communication_step(Unit *u, double t, double h, int stop) {
  @NAME@_machine *w = &u->machine;
  int calls, status = @UPPER@_OVERRUN;
  double until = t + h - u->start;
  if (!isfinite(t) || !isfinite(until)) return refused(u, "a communication step must begin and end at finite times");
  if (fabs(t - u->start - w->reals[AT_TIME]) > 1e-9 * fmax(1.0, fabs(t))) return refused(u, "a communication step must begin at the present time");
  if (until < w->reals[AT_TIME]) {
    if (until < w->reals[AT_TIME] - 1e-9 * fmax(1.0, fabs(until))) return refused(u, "a communication step must not go back");
    until = w->reals[AT_TIME]; /* by the last bits of a sum */
  }
  u->shown = CURRENT;
  for (calls = 0; calls < CALLS && status == @UPPER@_OVERRUN; ++calls) {
    w->ints[AT_EVENTS] = stop ? EVENT_ROOM - (2 * @UPPER@_ELEMENTS + 1) : 0; /* room for those of one instant */
    w->reals[AT_END] = until;
    if (calls == 0) @NAME@_jump(w);
    status = (int)loop_advance(w);
    if (status == AT_EVENTS_FULL) {
      status = @UPPER@_OVERRUN;
      if (stop && w->reals[AT_TIME] < until) break;
    }
  }
  w->ints[AT_EVENTS] = 0;
  if (SAMPLERS > 0) u->shown = STALE;
  if (status == @UPPER@_OVERRUN && !(stop && calls < CALLS)) return stopped(u, w, @UPPER@_OVERRUN);
  if (status != @UPPER@_DONE && status != @UPPER@_OVERRUN) return stopped(u, w, status);
  return status == @UPPER@_DONE ? 1 : 2;
}

/* Whether a time is the present one for an importer, whose sums of steps may end some last bits before it. */
static int now(const @NAME@_machine *w, double t) {
  return t < INFINITY && fabs(t - w->reals[AT_TIME]) <= 1e-12 * fmax(1.0, fabs(t));
}

/* What is due in event mode. *again: something has changed, ask again; *next: time of the next sample or jump, else infinite. */
static int events_here(Unit *u, int *again, double *next) {
  @NAME@_machine *w = &u->machine;
  const double stop = loop_next_stop(w);
  int status;
  if (now(w, stop)) w->reals[AT_TIME] = stop;
  w->ints[AT_EVENTS] = 0;
  @NAME@_jump(w);
  status = (int)loop_event_mode(w, u->entered);
  u->entered = u->fresh = 0;
  if (status > 0) return stopped(u, w, status);
  *next = loop_next_stop(w);
  *again = status < 0 || now(w, *next); /* a sample and a delayed output an ulp apart are one instant: no importer can step from one to the other */
  return 1;
}

static int enter_event_mode(Unit *u) {
  u->phase = EVENT;
  u->entered = 1;
  return 1;
}

static int set_time(Unit *u, double t) {
  if (!isfinite(t)) return refused(u, "the time of continuous-time mode must be finite");
  u->machine.reals[AT_TIME] = t - u->start;
  u->fresh = 0;
  return 1;
}

static int set_states(Unit *u, const double *x, size_t n) {
  size_t i;
  for (i = 0; i < n; ++i) {
    if (!isfinite(x[i])) {
      char words[512];
      const char *name = i < STATES ? @NAME@_output_name((int)i) : "a hidden force";
      snprintf(words, sizeof words, "`%.300s` is %g at t = %.9g s: a state must be finite", name, x[i], u->start + u->machine.reals[AT_TIME]);
      tell(&u->teller, u->name, DISCARD, words); /* a shorter step may do */
      return 0;
    }
  }
  for (i = 0; i < n; ++i) u->machine.x[i] = x[i];
  u->fresh = 0;
  return 1;
}

static int step_completed(Unit *u) {
  return loop_come_to(&u->machine) ? 1 : stopped(u, &u->machine, @UPPER@_NEGATIVE_BOUND);
}

static void nominals_of(Unit *u, double *x, size_t n) {
  size_t i;
  for (i = 0; i < n; ++i) x[i] = NOMINAL_SHARE * fmax(nominal[i], u->machine.scale[i]);
}

/* Derivatives of slopes and outputs along a change of states and settable numbers. */
static int directional(Unit *u, const unsigned int *of, size_t n, const unsigned int *along, size_t m, const double *seed, double *found) {
  const @NAME@_machine *w = u->exchange && u->phase >= EVENT ? &u->machine : seen(u);
  double k[INTEGRATED + SETTABLES + 1], y[INTEGRATED + @UPPER@_OUTPUTS + 1];
  size_t i;
  if (!w) return 0;
  memset(k, 0, sizeof k);
  for (i = 0; i < m; ++i) {
    const long j = (long)along[i];
    if (j > 0 && j < FIRST_STATE) k[INTEGRATED + j - 1] = seed[i];
    else if (j >= FIRST_STATE && j < FIRST_RATE) k[j - FIRST_STATE] = seed[i];
    else return refused(u, "a directional derivative goes along inputs, parameters and states");
  }
  @NAME@_model_forward(w->reals[AT_TIME], 0.0, w->x, k, w->p, w->m, y);
  for (i = 0; i < n; ++i) {
    const long j = (long)of[i];
    if (j >= FIRST_RATE && j < FIRST_OUTPUT) found[i] = y[j - FIRST_RATE];
    else if (j >= FIRST_OUTPUT && j < FIRST_INDICATOR) found[i] = y[INTEGRATED + STATES + j - FIRST_OUTPUT];
    else if (j >= FIRST_STATE && j < FIRST_RATE) found[i] = k[j - FIRST_STATE];
    else return refused(u, "a directional derivative is that of an output or of the derivative of a state");
  }
  return 1;
}

/* A saved state: a seal, and behind it the instance without its name and logger. Importers keep states in files, and files are damaged. */
#define SAVED_VERSION 1

typedef struct {
  char guid[64];
  uint64_t version, size, sum;
} Seal;
typedef struct {
  Seal seal;
  Unit unit;
} Saved;

/* A number of all bytes behind the seal, and of those of the seal in front of the sum. */
static uint64_t sum_of(const char *bytes) {
  uint64_t sum = UINT64_C(0x9e3779b97f4a7c15), word;
  size_t i;
  for (i = 0; i < sizeof(Saved); i += sizeof word) {
    const size_t left = sizeof(Saved) - i;
    if (i == offsetof(Saved, seal) + offsetof(Seal, sum)) continue;
    word = 0;
    memcpy(&word, bytes + i, left < sizeof word ? left : sizeof word);
    sum = (sum ^ word) * UINT64_C(0xbf58476d1ce4e5b9);
    sum = (sum ^ (sum >> 29)) * UINT64_C(0x94d049bb133111eb);
    sum ^= sum >> 32;
  }
  return sum;
}

/* Whether bytes are a state of this unit, to the last bit; nothing else reads them before. */
static int sound(Unit *u, const char *bytes, size_t size) {
  Seal seal;
  if (!bytes || size != sizeof(Saved)) return refused(u, "a state has another size than those of this unit");
  memcpy(&seal, bytes, sizeof seal);
  if (memcmp(seal.guid, GUID, sizeof GUID)) return refused(u, "a state must be one of this unit, but its GUID is another one, or damaged");
  if (seal.version != SAVED_VERSION || seal.size != sizeof(Saved)) return refused(u, "a state was written in another form, or is damaged");
  if (seal.sum != sum_of(bytes)) return refused(u, "a state is damaged: its checksum is not that of its bytes");
  return 1;
}

static int save(Unit *u, void **state) {
  Saved *saved = (Saved *)(*state ? *state : malloc(sizeof(Saved)));
  if (!saved) return refused(u, "there is no memory for a state");
  memset(saved, 0, sizeof *saved);
  memcpy(saved->seal.guid, GUID, sizeof GUID);
  saved->seal.version = SAVED_VERSION;
  saved->seal.size = sizeof(Saved);
  memcpy(&saved->unit, u, sizeof *u);
  memset(&saved->unit.teller, 0, sizeof saved->unit.teller);
  memset(saved->unit.name, 0, sizeof saved->unit.name);
  saved->seal.sum = sum_of((const char *)saved);
  *state = saved;
  return 1;
}

static int restore(Unit *u, const void *state) {
  const Teller teller = u->teller;
  const Unit *saved;
  char name[sizeof u->name];
  if (!sound(u, (const char *)state, sizeof(Saved))) return 0;
  saved = &((const Saved *)state)->unit;
  if (saved->exchange != u->exchange) return refused(u, "a state of model exchange is none of co-simulation, nor the other way round");
  memcpy(name, u->name, sizeof name);
  memcpy(u, saved, sizeof *u);
  u->teller = teller;
  memcpy(u->name, name, sizeof name);
  return 1;
}

static int written(Unit *u, const void *state, char *bytes, size_t size) {
  if (!sound(u, (const char *)state, size)) return 0;
  memcpy(bytes, state, size);
  return 1;
}

static int read_back(Unit *u, const char *bytes, size_t size, void **state) {
  if (!sound(u, bytes, size)) return 0;
  if (!*state) *state = malloc(sizeof(Saved));
  if (!*state) return refused(u, "there is no memory for a state");
  memcpy(*state, bytes, size);
  return 1;
}
