/* FMI 2.0 co-simulation around the step of a law: one number per variable, reads first, then drives, memory, gains. */
typedef unsigned int Reference;
typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef enum { MADE, STARTING, RUNNING, ENDED } Phase;
typedef struct {
  void (*logger)(void *environment, const char *name, Status status, const char *category, const char *message, ...);
  void *(*allocate)(size_t n, size_t size);
  void (*release)(void *memory);
  void (*finished)(void *environment, Status status);
  void *environment;
} Callbacks;
typedef struct {
  double y[SIZE(READS)], u[SIZE(DRIVES)], memory[SIZE(MEMORY)], gains[SIZE(GAINS)], start, time;
  long sample;
  Phase phase;
  Callbacks callbacks;
  char name[128];
} Law;

static void tell(const Callbacks *callbacks, const char *name, const char *message) {
  if (callbacks && callbacks->logger) callbacks->logger(callbacks->environment, name, ERROR, "logStatusError", message);
}

static Status refused(void *c, const char *message) {
  Law *law = (Law *)c;
  if (law) tell(&law->callbacks, law->name, message);
  return ERROR;
}

static double *place(Law *law, long i) {
  if (i < READS) return law->y + i;
  if (i < READS + DRIVES) return law->u + i - READS;
  if (i < READS + DRIVES + MEMORY) return law->memory + i - (READS + DRIVES);
  if (i < READS + DRIVES + MEMORY + GAINS) return law->gains + i - (READS + DRIVES + MEMORY);
  return 0;
}

static void begin(Law *law) {
  int i;
  memset(law->y, 0, sizeof law->y);
  memset(law->u, 0, sizeof law->u);
  law->start = law->time = 0.0;
  law->sample = 0;
  law->phase = MADE;
  for (i = 0; i < READS; ++i) law->y[i] = defaults[i];
  START(law->memory);
  GAINS_OF(law->gains);
}

static int look_ahead(Law *law) { /* what a sample would drive, without taking it */
  double memory[SIZE(MEMORY)];
  memcpy(memory, law->memory, sizeof memory);
  return SAMPLE(law, memory);
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *folder, const void *functions, int visible, int logging) {
  const Callbacks *callbacks = (const Callbacks *)functions;
  Law *law;
  (void)folder; (void)visible; (void)logging;
  if (type != 1) {
    tell(callbacks, name, "the unit is one of co-simulation, not of model exchange");
    return 0;
  }
  if (!guid || strcmp(guid, GUID)) {
    tell(callbacks, name, "the GUID is not that of this unit, which is " GUID);
    return 0;
  }
  law = (Law *)calloc(1, sizeof(Law));
  if (!law) return 0;
  if (callbacks) law->callbacks = *callbacks;
  if (name) strncpy(law->name, name, sizeof law->name - 1);
  begin(law);
  return law;
}

void fmi2FreeInstance(void *c) { free(c); }

Status fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start, int stops, double stop) {
  Law *law = (Law *)c;
  (void)tolerant; (void)tolerance; (void)stops; (void)stop;
  if (law->phase != MADE) return refused(c, "fmi2SetupExperiment must be called before initialisation");
  if (!isfinite(start)) return refused(c, "the start time must be finite");
  law->start = law->time = start;
  return OK;
}

Status fmi2EnterInitializationMode(void *c) {
  Law *law = (Law *)c;
  if (law->phase != MADE) return refused(c, "fmi2EnterInitializationMode must be called once, before all steps");
  law->phase = STARTING;
  return OK;
}

Status fmi2ExitInitializationMode(void *c) {
  Law *law = (Law *)c;
  if (law->phase != STARTING) return refused(c, "fmi2ExitInitializationMode must follow fmi2EnterInitializationMode");
  if (look_ahead(law)) return refused(c, "the law failed at its start");
  law->phase = RUNNING;
  return OK;
}

Status fmi2Terminate(void *c) {
  Law *law = (Law *)c;
  if (law->phase != RUNNING) return refused(c, "fmi2Terminate must follow initialisation");
  law->phase = ENDED;
  return OK;
}

Status fmi2Reset(void *c) {
  begin((Law *)c);
  return OK;
}

Status fmi2GetReal(void *c, const Reference *r, size_t n, double *value) {
  Law *law = (Law *)c;
  size_t i;
  if (law->phase == STARTING && look_ahead(law)) return refused(c, "the law failed at its start");
  for (i = 0; i < n; ++i) {
    const double *at = place(law, (long)r[i]);
    if (!at) return refused(c, "fmi2GetReal must name a variable of this unit");
    value[i] = *at;
  }
  return OK;
}

/* Sets all of these numbers, or, where one is refused, none. */
Status fmi2SetReal(void *c, const Reference *r, size_t n, const double *value) {
  Law *law = (Law *)c;
  double gains[SIZE(GAINS)];
  size_t i;
  memcpy(gains, law->gains, sizeof gains);
  for (i = 0; i < n; ++i) {
    double *at = place(law, (long)r[i]);
    if (!at) return refused(c, "fmi2SetReal must name a variable of this unit");
    if (at >= law->u && at < law->u + DRIVES) return refused(c, "fmi2SetReal must not write an output");
    if (law->phase >= RUNNING && at >= law->memory && at < law->memory + MEMORY)
      return refused(c, "fmi2SetReal must not write the memory of the law after initialisation");
    if (!isfinite(value[i])) return refused(c, "fmi2SetReal must give finite numbers");
    if (at >= law->gains && at < law->gains + GAINS) gains[at - law->gains] = value[i];
  }
  if (!ALLOWED(gains)) return refused(c, "gains must be within their bounds, and allowed beside one another");
  for (i = 0; i < n; ++i) *place(law, (long)r[i]) = value[i];
  return OK;
}

static Status failed(void *c, int status) {
  return refused(c, status == NOT_FINITE ? "a command, or a value that the law remembers, is no finite number" : "the law failed");
}

Status fmi2DoStep(void *c, double t, double h, int final) {
  Law *law = (Law *)c;
  const double period = PERIOD;
  (void)final;
  if (law->phase != RUNNING) return refused(c, "fmi2DoStep must follow initialisation");
  if (!isfinite(t) || !isfinite(h) || h < 0.0) return refused(c, "a communication step must have a finite time and a length >= 0");
  if (fabs(t - law->time) > 1e-9 * fmax(period, fabs(t))) return refused(c, "a communication step must begin where the last one ended");
  while (law->start + law->sample * period < t + h - 1e-9 * period) {
    const int status = SAMPLE(law, law->memory);
    if (status) return failed(c, status);
    ++law->sample;
  }
  law->time = t + h;
  return OK;
}

Status fmi2GetFMUstate(void *c, void **state) {
  if (!*state) *state = malloc(sizeof(Law));
  if (!*state) return ERROR;
  memcpy(*state, c, sizeof(Law));
  return OK;
}

Status fmi2SetFMUstate(void *c, void *state) {
  memcpy(c, state, sizeof(Law));
  return OK;
}

Status fmi2FreeFMUstate(void *c, void **state) {
  (void)c;
  free(*state);
  *state = 0;
  return OK;
}
