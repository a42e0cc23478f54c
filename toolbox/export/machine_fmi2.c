/* FMI 2.0. */
#include <stddef.h>
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef struct {
  void (*logger)(void *environment, const char *name, Status status, const char *category, const char *message, ...);
  void *(*allocate)(size_t n, size_t size);
  void (*release)(void *memory);
  void (*finished)(void *environment, Status status);
  void *environment;
} Teller;
typedef unsigned int Reference;
typedef struct {
  int again, terminate, nominals, values, next_defined;
  double next;
} EventInfo;
@CORE@
static void tell(const Teller *teller, const char *name, Status status, const char *message) {
  if (teller->logger) teller->logger(teller->environment, name, status, status == DISCARD ? "logStatusDiscard" : "logStatusError", "%s", message);
}

static Status answer(int done) { return done ? OK : ERROR; }
static Status wrong(void *c, const char *message) { return answer(refused((Unit *)c, message)); }
static int in(void *c, Phase phase) { return ((Unit *)c)->phase == phase; }

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *folder, const void *functions, int visible, int logging) {
  static const Teller none = {0, 0, 0, 0, 0};
  const Teller *teller = functions ? (const Teller *)functions : &none;
  (void)folder; (void)visible; (void)logging;
  if (type == 0 && !EXCHANGES) {
    tell(teller, name, ERROR, "the unit is one of co-simulation only: " NO_EXCHANGE);
    return 0;
  }
  if (!guid || strcmp(guid, GUID)) {
    tell(teller, name, ERROR, "the GUID is not that of this unit, which is " GUID);
    return 0;
  }
  return instance(name, type == 0, 0, 0, teller);
}

EXPORT void fmi2FreeInstance(void *c) { free(c); }

EXPORT Status fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start, int stops, double stop) {
  (void)tolerant; (void)tolerance; (void)stops; (void)stop;
  if (!in(c, MADE)) return wrong(c, "fmi2SetupExperiment must be called before initialisation");
  if (!isfinite(start)) return wrong(c, "the start time must be finite");
  ((Unit *)c)->start = start;
  return OK;
}

EXPORT Status fmi2EnterInitializationMode(void *c) {
  if (!in(c, MADE)) return wrong(c, "fmi2EnterInitializationMode must be called once, before all steps");
  ((Unit *)c)->phase = STARTING;
  return OK;
}

EXPORT Status fmi2ExitInitializationMode(void *c) {
  return in(c, STARTING) ? answer(initialised((Unit *)c)) : wrong(c, "fmi2ExitInitializationMode must follow fmi2EnterInitializationMode");
}

EXPORT Status fmi2Terminate(void *c) {
  if (((Unit *)c)->phase < STEPPING) return wrong(c, "fmi2Terminate must follow initialisation");
  ((Unit *)c)->phase = ENDED;
  return OK;
}

EXPORT Status fmi2Reset(void *c) {
  begin((Unit *)c);
  return OK;
}

EXPORT Status fmi2GetReal(void *c, const Reference *r, size_t n, double *value) { return answer(get_reals((Unit *)c, r, n, value)); }
EXPORT Status fmi2SetReal(void *c, const Reference *r, size_t n, const double *value) { return answer(set_reals((Unit *)c, r, n, value)); }
EXPORT Status fmi2GetInteger(void *c, const Reference *r, size_t n, int *value) { return answer(get_modes((Unit *)c, r, n, (int32_t *)value)); }

EXPORT Status fmi2DoStep(void *c, double t, double h, int final) {
  (void)final;
  if (!in(c, STEPPING)) return wrong(c, "fmi2DoStep must follow the initialisation of a unit of co-simulation");
  return answer(communication_step((Unit *)c, t, h, 0));
}

EXPORT Status fmi2EnterEventMode(void *c) {
  return in(c, CONTINUOUS) || in(c, EVENT) ? answer(enter_event_mode((Unit *)c)) : wrong(c, "fmi2EnterEventMode must follow continuous time");
}

EXPORT Status fmi2NewDiscreteStates(void *c, void *info) {
  EventInfo *events = (EventInfo *)info;
  if (!in(c, EVENT)) return wrong(c, "fmi2NewDiscreteStates belongs to event mode");
  memset(events, 0, sizeof *events);
  if (!events_here((Unit *)c, &events->again, &events->next)) return ERROR;
  events->values = events->again;
  events->next_defined = isfinite(events->next) != 0;
  events->next += ((Unit *)c)->start;
  return OK;
}

EXPORT Status fmi2EnterContinuousTimeMode(void *c) {
  if (!in(c, EVENT)) return wrong(c, "fmi2EnterContinuousTimeMode must follow event mode");
  ((Unit *)c)->phase = CONTINUOUS;
  return OK;
}

EXPORT Status fmi2CompletedIntegratorStep(void *c, int no_set_prior, int *enter, int *terminate) {
  (void)no_set_prior;
  *enter = *terminate = 0;
  return answer(step_completed((Unit *)c));
}

EXPORT Status fmi2SetTime(void *c, double t) {
  return answer(set_time((Unit *)c, t));
}

EXPORT Status fmi2SetContinuousStates(void *c, const double *x, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi2SetContinuousStates must give all states");
  return set_states((Unit *)c, x, n) ? OK : DISCARD;
}

EXPORT Status fmi2GetContinuousStates(void *c, double *x, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi2GetContinuousStates must ask for all states");
  memcpy(x, ((Unit *)c)->machine.x, n * sizeof *x);
  return OK;
}

EXPORT Status fmi2GetNominalsOfContinuousStates(void *c, double *x, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi2GetNominalsOfContinuousStates must ask for all states");
  nominals_of((Unit *)c, x, n);
  return OK;
}

EXPORT Status fmi2GetDerivatives(void *c, double *k, size_t n) {
  if (n != INTEGRATED) return wrong(c, "fmi2GetDerivatives must ask for all derivatives");
  memcpy(k, field_of((Unit *)c, &((Unit *)c)->machine), n * sizeof *k);
  return OK;
}

EXPORT Status fmi2GetEventIndicators(void *c, double *z, size_t n) {
  size_t i;
  if (n != INDICATORS) return wrong(c, "fmi2GetEventIndicators must ask for all indicators");
  for (i = 0; i < n; ++i) z[i] = indicator((Unit *)c, &((Unit *)c)->machine, (int)i);
  return OK;
}

EXPORT Status fmi2GetDirectionalDerivative(void *c, const Reference *of, size_t n, const Reference *along, size_t m, const double *seed, double *found) {
  return answer(directional((Unit *)c, of, n, along, m, seed, found));
}

EXPORT Status fmi2GetFMUstate(void *c, void **state) { return answer(save((Unit *)c, state)); }
EXPORT Status fmi2SetFMUstate(void *c, void *state) { return answer(restore((Unit *)c, state)); }

EXPORT Status fmi2FreeFMUstate(void *c, void **state) {
  (void)c;
  free(*state);
  *state = 0;
  return OK;
}

EXPORT Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *size) {
  (void)c; (void)state;
  *size = sizeof(Saved);
  return OK;
}

EXPORT Status fmi2SerializeFMUstate(void *c, void *state, char *bytes, size_t size) {
  return answer(written((Unit *)c, state, bytes, size));
}

EXPORT Status fmi2DeSerializeFMUstate(void *c, const char *bytes, size_t size, void **state) {
  return answer(read_back((Unit *)c, bytes, size, state));
}

/* what no machine has */
