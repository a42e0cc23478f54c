/* A drill string of up to eight inertias under a speed controller in C: fixed steps, its own logic of sticking, nothing of the toolbox.

     J_i w_i' = T_(i-1) - T_i - drag,     a_i' = w_i - w_(i+1),     T_i = k_i a_i + c_i (w_i - w_(i+1)),     J_n w_n' = T_(n-1) - drag - rock
     rock = kinetic + (static - kinetic) exp(-(decay |w|)^power) against the slip; in stick the torque that holds the bit, up to the static one

     wanted = P e + I z + Jc (w - f) / Tf,   f' = (w - f) / Tf,   z' = e + (u - wanted) / back,   u = wanted within its limits,   e = set-point - w

   The method is the classical one of Runge and Kutta. A step in which the bit speed changes its sign, or in which holding the bit takes more than the static
   torque, is halved to that instant. A sampled controller makes one Euler step of f and z a period, and its torque acts some samples later. */
#include <math.h>
#include <string.h>

enum { MOST = 8, ROOM = 2 * MOST + 2, LINE = 64, BISECTIONS = 45, WINDOWS = 400 };
enum { PERIOD, LATE, P, I, JC, TF, BACK, LOWEST, HIGHEST };
enum { STATIC, KINETIC, DECAY, POWER, TOP_DRAG, BIT_DRAG, NUMBERS };
enum { UNDECIDED, FREE, STICKS, STANDS, SWINGS, GROWS };

/* x: twists, speeds, then f and z of the controller. sign: 0 in stick. held: torque of a sampled controller. */
typedef struct {
  int n;
  const double *m, *inertia, *stiffness, *damping, *law;
  double reference, x[ROOM], sign, held, time, waiting[LINE];
  long sample;
} String;

static double wound(const String *s, const double *x, int i) {
  const double *w = x + s->n - 1;
  return s->stiffness[i] * x[i] + s->damping[i] * (w[i] - w[i + 1]);
}

static double torque(const String *s, const double *x, double *wanted) {
  const double *l = s->law, w = x[s->n - 1], f = x[2 * s->n - 1], z = x[2 * s->n];
  *wanted = l[P] * (s->reference - w) + l[I] * z + l[JC] * (w - f) / l[TF];
  return fmin(fmax(*wanted, l[LOWEST]), l[HIGHEST]);
}

static void slopes(const String *s, const double *x, double *dx) {
  const int n = s->n;
  const double *w = x + n - 1;
  double wanted, u = s->held, above = 0.0;
  int i;
  dx[2 * n - 1] = dx[2 * n] = 0.0;
  if (s->law[PERIOD] == 0.0) {
    u = torque(s, x, &wanted);
    dx[2 * n - 1] = (w[0] - x[2 * n - 1]) / s->law[TF];
    dx[2 * n] = s->reference - w[0] + (u - wanted) / s->law[BACK];
  }
  for (i = 0; i < n; ++i) {
    const double below = i < n - 1 ? wound(s, x, i) : 0.0;
    double push = above - below;
    if (i == 0) push += u - s->m[TOP_DRAG] * w[0];
    if (i == n - 1) {
      const double slow = s->m[DECAY] * s->sign * w[i];
      push -= s->m[BIT_DRAG] * w[i];
      push -= s->sign * (s->m[KINETIC] + (s->m[STATIC] - s->m[KINETIC]) * exp(-(s->m[POWER] == 1.0 ? slow : slow * slow)));
    }
    dx[n - 1 + i] = i == n - 1 && s->sign == 0.0 ? 0.0 : push / s->inertia[i];
    if (i < n - 1) dx[i] = w[i] - w[i + 1];
    above = below;
  }
}

static void stepped(const String *s, const double *from, double h, double *to) {
  const int size = 2 * s->n + 1;
  double k1[ROOM], k2[ROOM], k3[ROOM], k4[ROOM], y[ROOM] = {0.0};
  int i;
  slopes(s, from, k1);
  for (i = 0; i < size; ++i) y[i] = from[i] + 0.5 * h * k1[i];
  slopes(s, y, k2);
  for (i = 0; i < size; ++i) y[i] = from[i] + 0.5 * h * k2[i];
  slopes(s, y, k3);
  for (i = 0; i < size; ++i) y[i] = from[i] + h * k3[i];
  slopes(s, y, k4);
  for (i = 0; i < size; ++i) to[i] = from[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
}

/* Whether the mode of the bit ends at a state. */
static int ends(const String *s, const double *x) {
  return s->sign != 0.0 ? x[2 * s->n - 2] * s->sign < 0.0 : fabs(wound(s, x, s->n - 2)) > s->m[STATIC];
}

/* One step, through all changes of mode in it. stuck: time in stick. release: time of the last release, and of that before. */
static void step(String *s, double h, double *stuck, double *release) {
  double left = h, x[ROOM] = {0.0};
  while (left > 0.0) {
    double part = left;
    stepped(s, s->x, left, x);
    if (ends(s, x)) {
      double low = 0.0, high = left;
      int i;
      for (i = 0; i < BISECTIONS; ++i) {
        const double middle = 0.5 * (low + high);
        stepped(s, s->x, middle, x);
        if (ends(s, x)) high = middle; else low = middle;
      }
      part = high;
      stepped(s, s->x, part, x);
    }
    if (s->sign == 0.0) *stuck += part;
    memcpy(s->x, x, sizeof x);
    s->time += part, left -= part;
    if (ends(s, x)) {
      const double last = s->sign;
      double free;
      s->x[2 * s->n - 2] = 0.0;
      free = wound(s, s->x, s->n - 2);
      s->sign = last != 0.0 && fabs(free) <= s->m[STATIC] ? 0.0 : copysign(1.0, free);
      if (last == 0.0) release[1] = release[0], release[0] = s->time;
    }
  }
}

/* A sample of the controller, where it has a period. first: the first one, which begins with the torque that acts. */
static void sampled(String *s) {
  const double *l = s->law, w = s->x[s->n - 1];
  double wanted, u, *f = s->x + 2 * s->n - 1, *z = f + 1;
  const int late = (int)l[LATE];
  if (s->sample == 0 && s->held != 0.0) *f = w, *z = l[I] == 0.0 ? 0.0 : (s->held - l[P] * (s->reference - w)) / l[I];
  u = torque(s, s->x, &wanted);
  *z += l[PERIOD] * (s->reference - w + (u - wanted) / fmax(l[BACK], l[PERIOD] * l[I]));
  *f += l[PERIOD] * (w - *f) / l[TF];
  s->waiting[s->sample % LINE] = u;
  if (s->sample >= late) s->held = s->waiting[(s->sample - late) % LINE];
  ++s->sample;
}

/* Smooth running at the set-point, or rest. */
static void begin(String *s, int smooth) {
  const int n = s->n;
  int i;
  memset(s->x, 0, sizeof s->x);
  s->sign = s->held = s->time = 0.0, s->sample = 0;
  if (!smooth) return;
  {
    const double w = s->reference, slow = s->m[DECAY] * w;
    const double rock = s->m[KINETIC] + (s->m[STATIC] - s->m[KINETIC]) * exp(-(s->m[POWER] == 1.0 ? slow : slow * slow)) + s->m[BIT_DRAG] * w;
    for (i = 0; i < n - 1; ++i) s->x[i] = rock / s->stiffness[i];
    for (i = 0; i <= n; ++i) s->x[n - 1 + i] = w; /* f is the speed as well */
    s->held = rock + s->m[TOP_DRAG] * w;
    s->x[2 * n] = s->held / s->law[I];
    s->sign = 1.0;
  }
}

/* numbers: of the machine, then inertias, stiffnesses, dampings. start: 0 smooth running with the bit a thousandth faster, 1 rest, 2 and up: taken over from
   the cycle of `initial`, which has run for `before` seconds from rest, at phase (start - 2) / phases. window [s]. found: time [s] of the decision, swing. */
int told(int n, const double *numbers, const double *law, const double *initial, double reference, int start, int phases, double before, double h,
         double window, double *found) {
  String s;
  double swings[WINDOWS], stuck = 0.0, release[2] = {-1.0, -1.0};
  int sticky = 0, quiet = 0, full = 0, k;
  s.n = n, s.m = numbers, s.inertia = numbers + NUMBERS, s.stiffness = s.inertia + n, s.damping = s.stiffness + n - 1;
  s.law = start >= 2 ? initial : law, s.reference = reference;
  begin(&s, start == 0);
  if (start == 0) s.x[2 * n - 2] *= 1.001;
  if (start >= 2) {
    double wanted, until, u;
    while (s.time < before - 1e-9) {
      if (s.time < 0.8 * before) stuck = 0.0;
      step(&s, fmin(h, before - s.time), &stuck, release);
    }
    if (release[1] < 0.0 || stuck < 1e-3) until = before; /* no stick-slip to end: taken over as it is */
    else until = release[1] + (release[0] - release[1]) * (start - 2) / phases;
    begin(&s, 0);
    while (s.time < until - 1e-9) step(&s, fmin(h, until - s.time), &stuck, release);
    u = torque(&s, s.x, &wanted);
    s.law = law, s.held = u, s.sample = 0, s.time = 0.0;
    s.x[2 * n - 1] = s.x[n - 1];
    s.x[2 * n] = (u - law[P] * (reference - s.x[n - 1])) / law[I];
  }
  for (k = 0; k < WINDOWS; ++k) {
    double low = INFINITY, high = -INFINITY;
    const double end = window * (k + 1);
    stuck = 0.0;
    while (s.time < end - 1e-9) {
      double until = end;
      if (law[PERIOD] > 0.0) sampled(&s), until = fmin(end, s.sample * law[PERIOD]);
      while (s.time < until - 1e-9) {
        step(&s, fmin(h, until - s.time), &stuck, release);
        low = fmin(low, s.x[2 * n - 2]), high = fmax(high, s.x[2 * n - 2]);
      }
    }
    swings[k] = (high - low) / reference;
    found[0] = s.time, found[1] = swings[k];
    sticky = stuck > 1e-6 ? sticky + 1 : 0;
    full = stuck > 0.999 * window ? full + 1 : 0;
    quiet = stuck > 1e-6 ? 0 : quiet + 1;
    if (full >= 10) return STANDS;
    if (sticky >= 40) return STICKS;
    if (start == 0 && (stuck > 1e-6 || swings[k] > 0.02)) return GROWS;
    if (quiet && swings[k] < (start == 0 ? 1e-5 : 1e-4)) return FREE;
    if (start && quiet > 60 && fabs(swings[k] / swings[k - 40] - 1.0) < 1e-3) return SWINGS;
  }
  if (start == 0) return swings[WINDOWS - 1] < swings[WINDOWS - 100] ? FREE : GROWS;
  return UNDECIDED;
}
