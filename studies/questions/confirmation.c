/* A drill string of two inertias under two sampled laws in C, one after the other: fixed steps, its own logic of sticking, nothing of the toolbox.

     J1 w1' = u - T - d1 w1,     a' = w1 - w2,     T = k a + c (w1 - w2),     J2 w2' = T - d2 w2 - rock
     rock = load [mu_k + (mu_s - mu_k) exp(-(decay |w2|)^power)] sgn w2 in slip; in stick whatever holds the bit, up to load mu_s
     load = radius x what is asked of the weight x how the weight varies by itself x what the hoist gives of the parts that a law asks

   by the classical Runge-Kutta method. A step in which the bit speed changes its sign is cut where the line between both ends is zero, and the bit is held
   from there; it is let go at the end of the first step in which holding it takes more than the rock can give. */
#include <math.h>
#include <stddef.h>
#include "before.h"
#include "law.h"

enum { J1, J2, K, C, D1, D2, LOAD, STATIC, KINETIC, DECAY, POWER, NUMBERS };
enum { STUCK, SPEED, TORQUE, SQUARE, LIMITED, SWING, RATE, RESULTS };
enum { LINE = 512 }; /* samples that a command may wait for */

static void slopes(const double *p, double load, const double *x, double u, double sign, double *dx) {
  const double wound = p[K] * x[0] + p[C] * (x[1] - x[2]), slow = p[DECAY] * fabs(x[2]);
  const double part = exp(p[POWER] == 1.0 ? -slow : -pow(slow, p[POWER]));
  dx[0] = x[1] - x[2];
  dx[1] = (u - wound - p[D1] * x[1]) / p[J1];
  dx[2] = sign == 0.0 ? 0.0 : (wound - p[D2] * x[2] - sign * load * (p[KINETIC] + (p[STATIC] - p[KINETIC]) * part)) / p[J2];
}

static void stepped(const double *p, double load, double *x, double u, double sign, double h) {
  double dx[3], y[3], sum[3] = {0.0, 0.0, 0.0};
  int stage, i;
  for (i = 0; i < 3; ++i) y[i] = x[i];
  for (stage = 0; stage < 4; ++stage) {
    slopes(p, load, y, u, sign, dx);
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

/* x: twist, top speed, bit speed at the start;  noise, varied: one number per sample, of the speed and of the weight (1 where it does not vary);  nodes, values:
   set-point;  taken: sample of the takeover;  late: samples until a command acts;  hoist: how many more the weight is late, and how far it goes in one, in
   parts of it;  parts: steps per sample;  limits: of the torque;  first: sample from which on is judged;  found: see above, of these samples. */
int confirmed(const double *p, double *x, const double *noise, const double *varied, int samples, const double *nodes, const double *values, int count, int taken,
              int late, const double *hoist, int parts, const double *limits, int first, double *found) {
  double memory[BEFORE_MEMORY + LAW_MEMORY], torques[LINE], weights[LINE], y[4], u = 0.0, given = 1.0, lowest = 1.0, highest = 1.0;
  double sign = fabs(x[2]) > 0.0 ? copysign(1.0, x[2]) : 0.0;
  const double h = LAW_PERIOD / parts;
  const int slow = late + (int)hoist[0];
  int k, i;
  if (slow >= LINE) return 1;
  for (i = 0; i < RESULTS; ++i) found[i] = 0.0;
  before_start(memory);
  law_start(memory + BEFORE_MEMORY);
  for (k = 0; k < samples; ++k) {
    double out[2] = {0.0, 1.0}, load, moved;
    y[0] = x[1] + noise[k], y[1] = u, y[2] = between(nodes, values, count, k * LAW_PERIOD), y[3] = 1.0;
    if (k < taken ? before_step(y, memory, out) : law_step(y, memory + BEFORE_MEMORY, out)) return 1;
    torques[k % LINE] = out[0], weights[k % LINE] = out[1];
    if (k >= late) u = torques[(k - late) % LINE];
    if (k >= slow) {
      moved = fmax(fmin(weights[(k - slow) % LINE] - given, hoist[1]), -hoist[1]);
      given += moved;
      if (k > taken + slow + 1) found[RATE] = fmax(found[RATE], fabs(moved) / LAW_PERIOD);
    }
    load = p[LOAD] * varied[k] * given;
    for (i = 0; i < parts; ++i) {
      double dx[3], free, old[3] = {x[0], x[1], x[2]};
      stepped(p, load, x, u, sign, h);
      if (sign != 0.0 && x[2] * sign <= 0.0) {
        const double part = old[2] * sign > 0.0 ? old[2] / (old[2] - x[2]) : 0.0;
        x[0] = old[0], x[1] = old[1], x[2] = old[2];
        stepped(p, load, x, u, sign, part * h);
        x[2] = 0.0;
        free = p[K] * x[0] + p[C] * x[1];
        sign = fabs(free) <= load * p[STATIC] ? 0.0 : copysign(1.0, free);
        stepped(p, load, x, u, sign, (1.0 - part) * h);
      }
      slopes(p, load, x, u, sign, dx);
      free = p[K] * x[0] + p[C] * (x[1] - x[2]);
      if (sign == 0.0) {
        if (k >= first) found[STUCK] += h;
        if (fabs(free) > load * p[STATIC]) sign = copysign(1.0, free);
      }
    }
    if (k >= first) {
      lowest = k == first ? given : fmin(lowest, given), highest = k == first ? given : fmax(highest, given);
      found[SPEED] += x[2], found[TORQUE] += u, found[SQUARE] += u * u;
      found[LIMITED] += u < limits[0] + 1.0 || u > limits[1] - 1.0 ? 1.0 : 0.0;
    }
  }
  for (i = SPEED; i <= LIMITED; ++i) found[i] /= samples - first;
  found[SWING] = highest - lowest;
  return 0;
}
