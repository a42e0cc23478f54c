/* A drill string of two inertias under two sampled laws in C, one after the other: fixed steps, its own logic of sticking, nothing of the toolbox.

     J1 w1' = u - T - d1 w1,     a' = w1 - w2,     T = k a + c (w1 - w2),     J2 w2' = T - d2 w2 - rock
     rock = load [mu_k + (mu_s - mu_k) exp(-decay |w2|)] sgn w2 in slip; in stick whatever holds the bit, up to load mu_s

   by the classical Runge-Kutta method. A step in which the bit speed changes its sign is cut where the line between both ends is zero, and the bit is held
   from there; it is let go at the end of the first step in which holding it takes more than the rock can give. */
#include <math.h>
#include <stddef.h>
#include "before.h"
#include "law.h"

enum { J1, J2, K, C, D1, D2, LOAD, STATIC, KINETIC, DECAY, NUMBERS };
enum { STUCK, SPEED, TORQUE, SQUARE, LIMITED, RESULTS };

static void slopes(const double *p, const double *x, double u, double sign, double *dx) {
  const double wound = p[K] * x[0] + p[C] * (x[1] - x[2]);
  dx[0] = x[1] - x[2];
  dx[1] = (u - wound - p[D1] * x[1]) / p[J1];
  dx[2] = sign == 0.0 ? 0.0 : (wound - p[D2] * x[2] - sign * p[LOAD] * (p[KINETIC] + (p[STATIC] - p[KINETIC]) * exp(-p[DECAY] * fabs(x[2])))) / p[J2];
}

static void stepped(const double *p, double *x, double u, double sign, double h) {
  double dx[3], y[3], sum[3] = {0.0, 0.0, 0.0};
  int stage, i;
  for (i = 0; i < 3; ++i) y[i] = x[i];
  for (stage = 0; stage < 4; ++stage) {
    slopes(p, y, u, sign, dx);
    for (i = 0; i < 3; ++i) {
      sum[i] += (stage == 0 || stage == 3 ? 1.0 : 2.0) * dx[i] / 6.0;
      y[i] = x[i] + (stage == 2 ? h : 0.5 * h) * dx[i];
    }
  }
  for (i = 0; i < 3; ++i) x[i] += h * sum[i];
}

static double between(const double *t, const double *v, int n, double at) {
  int i;
  for (i = 1; i < n; ++i)
    if (at < t[i]) return at <= t[i - 1] ? v[i - 1] : v[i - 1] + (v[i] - v[i - 1]) * (at - t[i - 1]) / (t[i] - t[i - 1]);
  return v[n - 1];
}

/* x: twist, top speed, bit speed at the start;  noise: one number per sample;  nodes, values: set-point;  taken: sample of the takeover;  late: samples until a
   command acts, at most 30;  parts: steps per sample;  limits: of the torque;  first: sample from which on is judged;  found: see above, of these samples. */
int confirmed(const double *p, double *x, const double *noise, int samples, const double *nodes, const double *values, int count, int taken, int late,
              int parts, const double *limits, int first, double *found) {
  double memory[BEFORE_MEMORY + LAW_MEMORY], queue[32], y[3], u = 0.0, sign = fabs(x[2]) > 0.0 ? copysign(1.0, x[2]) : 0.0;
  const double h = LAW_PERIOD / parts;
  int k, i;
  for (i = 0; i < RESULTS; ++i) found[i] = 0.0;
  before_start(memory);
  law_start(memory + BEFORE_MEMORY);
  for (i = 0; i < 32; ++i) queue[i] = u;
  for (k = 0; k < samples; ++k) {
    y[0] = x[1] + noise[k], y[1] = u, y[2] = between(nodes, values, count, k * LAW_PERIOD);
    if (k < taken ? before_step(y, memory, &queue[k % 32]) : law_step(y, memory + BEFORE_MEMORY, &queue[k % 32])) return 1;
    if (k >= late) u = queue[(k - late) % 32];
    for (i = 0; i < parts; ++i) {
      double dx[3], free, old[3] = {x[0], x[1], x[2]};
      stepped(p, x, u, sign, h);
      if (sign != 0.0 && x[2] * sign <= 0.0) {
        const double part = old[2] * sign > 0.0 ? old[2] / (old[2] - x[2]) : 0.0;
        x[0] = old[0], x[1] = old[1], x[2] = old[2];
        stepped(p, x, u, sign, part * h);
        x[2] = 0.0;
        free = p[K] * x[0] + p[C] * x[1];
        sign = fabs(free) <= p[LOAD] * p[STATIC] ? 0.0 : copysign(1.0, free);
        stepped(p, x, u, sign, (1.0 - part) * h);
      }
      slopes(p, x, u, sign, dx);
      free = p[K] * x[0] + p[C] * (x[1] - x[2]);
      if (sign == 0.0) {
        if (k >= first) found[STUCK] += h;
        if (fabs(free) > p[LOAD] * p[STATIC]) sign = copysign(1.0, free);
      }
    }
    if (k >= first) {
      found[SPEED] += x[2], found[TORQUE] += u, found[SQUARE] += u * u;
      found[LIMITED] += u < limits[0] + 1.0 || u > limits[1] - 1.0 ? 1.0 : 0.0;
    }
  }
  for (i = SPEED; i < RESULTS; ++i) found[i] /= samples - first;
  return 0;
}
