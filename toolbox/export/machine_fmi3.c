/* FMI 3.0. */
#include <stdbool.h>
#include <stddef.h>
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef struct {
  void (*logger)(void *environment, Status status, const char *category, const char *message);
  void *environment;
} Teller;
typedef unsigned int Reference;
@CORE@
static void tell(const Teller *teller, const char *name, Status status, const char *message) {
  (void)name;
  if (teller->logger) teller->logger(teller->environment, status, status == DISCARD ? "logStatusDiscard" : "logStatusError", message);
}

static Status answer(int done) { return done ? OK : ERROR; }
static Status wrong(void *c, const char *message) { return answer(refused((Unit *)c, message)); }
static int in(void *c, Phase phase) { return ((Unit *)c)->phase == phase; }

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

static void *made(const char *name, const char *token, int exchange, bool events_used, bool early, void *environment, void *logger) {
  Teller teller;
  memcpy(&teller.logger, &logger, sizeof logger);
  teller.environment = environment;
  if (exchange && !EXCHANGES) {
    tell(&teller, name, ERROR, "the unit is one of co-simulation only: " NO_EXCHANGE);
    return 0;
  }
  if (!token || strcmp(token, GUID)) {
    tell(&teller, name, ERROR, "the instantiation token is not that of this unit, which is " GUID);
    return 0;
  }
  return instance(name, exchange, early, events_used, &teller);
}

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible, bool logging, void *environment, void *logger) {
  (void)resources; (void)visible; (void)logging;
  return made(name, token, 1, false, false, environment, logger);
}

EXPORT void *fmi3InstantiateCoSimulation(
    const char *name, const char *token, const char *resources, bool visible, bool logging, bool events_used, bool early, const Reference *intermediate,
    size_t n, void *environment, void *logger, void *update) {
  (void)resources; (void)visible; (void)logging; (void)intermediate; (void)n; (void)update;
  return made(name, token, 0, events_used, early, environment, logger);
}

EXPORT void *fmi3InstantiateScheduledExecution(
    const char *name, const char *token, const char *resources, bool visible, bool logging, void *environment, void *logger, void *update, void *lock,
    void *unlock) {
  Teller teller;
  (void)token; (void)resources; (void)visible; (void)logging; (void)update; (void)lock; (void)unlock;
  memcpy(&teller.logger, &logger, sizeof logger);
  teller.environment = environment;
  tell(&teller, name, ERROR, "the unit has no scheduled execution");
  return 0;
}

EXPORT void fmi3FreeInstance(void *c) { free(c); }

EXPORT Status fmi3EnterInitializationMode(void *c, bool tolerant, double tolerance, double start, bool stops, double stop) {
  (void)tolerant; (void)tolerance; (void)stops; (void)stop;
  if (!in(c, MADE)) return wrong(c, "fmi3EnterInitializationMode must be called once, before all steps");
  if (!isfinite(start)) return wrong(c, "the start time must be finite");
  ((Unit *)c)->start = start;
  ((Unit *)c)->phase = STARTING;
  return OK;
}

EXPORT Status fmi3ExitInitializationMode(void *c) {
  return in(c, STARTING) ? answer(initialised((Unit *)c)) : wrong(c, "fmi3ExitInitializationMode must follow fmi3EnterInitializationMode");
}

EXPORT Status fmi3Terminate(void *c) {
  if (((Unit *)c)->phase < STEPPING) return wrong(c, "fmi3Terminate must follow initialisation");
  ((Unit *)c)->phase = ENDED;
  return OK;
}

EXPORT Status fmi3Reset(void *c) {
  begin((Unit *)c);
  return OK;
}

EXPORT Status fmi3GetFloat64(void *c, const Reference *r, size_t n, double *value, size_t size) {
  return n != size ? wrong(c, "fmi3GetFloat64 must ask for one number for each reference") : answer(get_reals((Unit *)c, r, n, value));
}

EXPORT Status fmi3SetFloat64(void *c, const Reference *r, size_t n, const double *value, size_t size) {
  return n != size ? wrong(c, "fmi3SetFloat64 must give one number for each reference") : answer(set_reals((Unit *)c, r, n, value));
}

EXPORT Status fmi3GetInt32(void *c, const Reference *r, size_t n, int32_t *value, size_t size) {
  return n != size ? wrong(c, "fmi3GetInt32 must ask for one number for each reference") : answer(get_modes((Unit *)c, r, n, value));
}

EXPORT Status fmi3DoStep(void *c, double t, double h, bool no_set_prior, bool *events, bool *terminate, bool *early, double *last) {
  Unit *u = (Unit *)c;
  int done;
  (void)no_set_prior;
  *events = *terminate = *early = false;
  if (u->phase != STEPPING) return wrong(c, "fmi3DoStep must be called in step mode");
  done = communication_step(u, t, h, u->early);
  *last = done == 1 ? t + h : u->start + u->machine.reals[AT_TIME];
  if (done == 2) {
    *early = true;
    *events = u->events_used != 0;
  }
  return answer(done);
}

EXPORT Status fmi3EnterEventMode(void *c) {
  Unit *u = (Unit *)c;
  if (!u->exchange) { /* a machine has already switched; what the importer sets now jumps in its next step */
    if (u->phase != STEPPING || !u->events_used) return wrong(c, "fmi3EnterEventMode must follow a step of a unit that was made for it");
    u->phase = EVENT;
    return OK;
  }
  return in(c, CONTINUOUS) || in(c, EVENT) ? answer(enter_event_mode(u)) : wrong(c, "fmi3EnterEventMode must follow continuous time");
}

EXPORT Status fmi3EnterStepMode(void *c) {
  Unit *u = (Unit *)c;
  if (u->exchange || u->phase < STEPPING) return wrong(c, "fmi3EnterStepMode belongs to co-simulation");
  u->phase = STEPPING;
  return OK;
}

EXPORT Status fmi3UpdateDiscreteStates(void *c, bool *again, bool *terminate, bool *nominals, bool *values, bool *next_defined, double *next) {
  int changed = 0;
  *again = *terminate = *nominals = *values = *next_defined = false;
  *next = 0.0;
  if (!((Unit *)c)->exchange && (in(c, EVENT) || in(c, STEPPING))) return OK;
  if (!in(c, EVENT)) return wrong(c, "fmi3UpdateDiscreteStates belongs to event mode");
  if (!events_here((Unit *)c, &changed, next)) return ERROR;
  *again = *values = changed != 0;
  *next_defined = isfinite(*next) != 0;
  *next += ((Unit *)c)->start;
  return OK;
}

EXPORT Status fmi3EvaluateDiscreteStates(void *c) {
  (void)c;
  return OK;
}

EXPORT Status fmi3EnterContinuousTimeMode(void *c) {
  if (!in(c, EVENT) || !((Unit *)c)->exchange) return wrong(c, "fmi3EnterContinuousTimeMode must follow event mode");
  ((Unit *)c)->phase = CONTINUOUS;
  return OK;
}

EXPORT Status fmi3CompletedIntegratorStep(void *c, bool no_set_prior, bool *enter, bool *terminate) {
  (void)no_set_prior;
  *enter = *terminate = false;
  return answer(step_completed((Unit *)c));
}

EXPORT Status fmi3SetTime(void *c, double t) {
  return answer(set_time((Unit *)c, t));
}

EXPORT Status fmi3SetContinuousStates(void *c, const double *x, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi3SetContinuousStates must give all states");
  return set_states((Unit *)c, x, n) ? OK : DISCARD;
}

EXPORT Status fmi3GetContinuousStates(void *c, double *x, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi3GetContinuousStates must ask for all states");
  memcpy(x, ((Unit *)c)->machine.x, n * sizeof *x);
  return OK;
}

EXPORT Status fmi3GetNominalsOfContinuousStates(void *c, double *x, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi3GetNominalsOfContinuousStates must ask for all states");
  nominals_of((Unit *)c, x, n);
  return OK;
}

EXPORT Status fmi3GetContinuousStateDerivatives(void *c, double *k, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi3GetContinuousStateDerivatives must ask for all derivatives");
  memcpy(k, field_of((Unit *)c, &((Unit *)c)->machine), n * sizeof *k);
  return OK;
}

EXPORT Status fmi3GetEventIndicators(void *c, double *z, size_t n) {
  size_t i;
  if (n != INDICATORS) return wrong(c, "fmi3GetEventIndicators must ask for all indicators");
  for (i = 0; i < n; ++i) z[i] = indicator((Unit *)c, &((Unit *)c)->machine, (int)i);
  return OK;
}

EXPORT Status fmi3GetNumberOfEventIndicators(void *c, size_t *n) {
  (void)c;
  *n = INDICATORS;
  return OK;
}

EXPORT Status fmi3GetNumberOfContinuousStates(void *c, size_t *n) {
  (void)c;
  *n = INTEGRATED;
  return OK;
}

EXPORT Status fmi3GetDirectionalDerivative(
    void *c, const Reference *of, size_t n, const Reference *along, size_t m, const double *seed, size_t seeds, double *found, size_t size) {
  if (seeds != m || size != n) return wrong(c, "fmi3GetDirectionalDerivative must give one number for each reference");
  return answer(directional((Unit *)c, of, n, along, m, seed, found));
}

EXPORT Status fmi3GetFMUState(void *c, void **state) { return answer(save((Unit *)c, state)); }
EXPORT Status fmi3SetFMUState(void *c, void *state) { return answer(restore((Unit *)c, state)); }

EXPORT Status fmi3FreeFMUState(void *c, void **state) {
  (void)c;
  free(*state);
  *state = 0;
  return OK;
}

EXPORT Status fmi3SerializedFMUStateSize(void *c, void *state, size_t *size) {
  (void)c; (void)state;
  *size = sizeof(Saved);
  return OK;
}

EXPORT Status fmi3SerializeFMUState(void *c, void *state, unsigned char *bytes, size_t size) {
  return answer(written((Unit *)c, state, (char *)bytes, size));
}

EXPORT Status fmi3DeserializeFMUState(void *c, const unsigned char *bytes, size_t size, void **state) {
  return answer(read_back((Unit *)c, (const char *)bytes, size, state));
}

/* what no machine has */
