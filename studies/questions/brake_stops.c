/* A disc brake between the samples of a control law, in C: fixed steps, its own logic of sticking, nothing of the toolbox.

     I w' = T - r F,     m v' = F + a sin(2 pi f t) - k x - c v,     x' = v,     n' = clip((clip(u, 0, highest) - n) / lag, +-rate)
     F = 2 n mu(|r w - v|) sgn(r w - v) in slip; in stick whatever holds the pad on the disc, up to 2 n mu_s

   by the classical Runge-Kutta method. mu is a table that is linear between its speeds. A step in which the slip changes its sign ends at the zero of the line
   between both ends; pad and disc are then held together, and are let go at the end of the first step in which holding them takes more than friction can give. */
#include <math.h>

enum { INERTIA, RADIUS, MASS, STIFFNESS, DAMPING, STATIC, LAG, RATE, HIGHEST, ROUGH, FREQUENCY, PHASE, DRIVE, NUMBERS };
enum { W, X, V, N, STATES };
enum { TIME, SIGN, STANDS, ANGLE, RELEASES, RESULTS };

static double coefficient(const double *speeds, const double *mu, int rows, double v) {
  int i;
  for (i = 1; i < rows; ++i)
    if (v < speeds[i]) return mu[i - 1] + (mu[i] - mu[i - 1]) * (v - speeds[i - 1]) / (speeds[i] - speeds[i - 1]);
  return mu[rows - 1];
}

/* the slopes at x; the friction on the pads in *grip */
static void slopes(const double *p, const double *speeds, const double *mu, int rows, double t, double u, double sign, const double *x, double *dx, double *grip) {
  const double pi = 3.14159265358979323846, r = p[RADIUS];
  const double shake = p[ROUGH] * sin(2 * pi * p[FREQUENCY] * t + p[PHASE]), springs = shake - p[STIFFNESS] * x[X] - p[DAMPING] * x[V];
  const double wish = fmin(fmax(u, 0.0), p[HIGHEST]);
  if (sign == 0.0) {
    const double together = (springs + p[DRIVE] / r) / (p[MASS] + p[INERTIA] / (r * r));
    *grip = p[MASS] * together - springs;
    dx[W] = together / r;
    dx[V] = together;
  } else {
    *grip = 2 * x[N] * sign * coefficient(speeds, mu, rows, fabs(r * x[W] - x[V]));
    dx[W] = (p[DRIVE] - r * *grip) / p[INERTIA];
    dx[V] = (*grip + springs) / p[MASS];
  }
  dx[X] = x[V];
  dx[N] = p[LAG] > 0 ? fmin(fmax((wish - x[N]) / p[LAG], -p[RATE]), p[RATE]) : 0.0;
}

static void stepped(const double *p, const double *speeds, const double *mu, int rows, double t, double u, double sign, double h, double *x) {
  double d[4][STATES], y[STATES], grip;
  int i, s;
  const double part[4] = {0.0, 0.5, 0.5, 1.0};
  for (s = 0; s < 4; ++s) {
    for (i = 0; i < STATES; ++i) y[i] = x[i] + (s ? part[s] * h * d[s - 1][i] : 0.0);
    slopes(p, speeds, mu, rows, t + part[s] * h, u, sign, y, d[s], &grip);
  }
  for (i = 0; i < STATES; ++i) x[i] += h / 6 * (d[0][i] + 2 * d[1][i] + 2 * d[2][i] + d[3][i]);
}

/* Go on for `steps` steps of h with the command u. `out`: time, sign of the slip (0 in stick), time of standstill (-1 for none yet), angle turned until then,
   releases from stick while the disc turns faster than `slowest`; a negative `slowest` counts every release. Returns the torque of the brake at the end. */
double advance(const double *p, const double *speeds, const double *mu, int rows, double u, double h, int steps, double slowest, double *x, double *out) {
  double grip = 0.0, d[STATES];
  int k, i;
  if (p[LAG] <= 0) x[N] = fmin(fmax(u, 0.0), p[HIGHEST]);
  for (k = 0; k < steps; ++k) {
    double before[STATES], left = h, slip, was, part;
    for (i = 0; i < STATES; ++i) before[i] = x[i];
    was = p[RADIUS] * x[W] - x[V];
    stepped(p, speeds, mu, rows, out[TIME], u, out[SIGN], h, x);
    slip = p[RADIUS] * x[W] - x[V];
    if (out[SIGN] != 0.0 && slip * out[SIGN] < 0.0) { /* the slip has passed zero: hold from there on */
      part = was / (was - slip);
      for (i = 0; i < STATES; ++i) x[i] = before[i];
      stepped(p, speeds, mu, rows, out[TIME], u, out[SIGN], part * h, x);
      x[V] = p[RADIUS] * x[W];
      left = (1 - part) * h;
      out[SIGN] = 0.0;
      stepped(p, speeds, mu, rows, out[TIME] + part * h, u, 0.0, left, x);
    }
    out[TIME] += h;
    if (out[STANDS] < 0.0) {
      out[ANGLE] += h * (before[W] + x[W]) / 2;
      if (x[W] <= 0.0) out[STANDS] = out[TIME];
    }
    if (out[SIGN] == 0.0) {
      x[V] = p[RADIUS] * x[W];
      slopes(p, speeds, mu, rows, out[TIME], u, 0.0, x, d, &grip);
      if (fabs(grip) > 2 * x[N] * p[STATIC]) {
        out[SIGN] = grip > 0 ? 1.0 : -1.0;
        if (slowest < 0.0 || (out[STANDS] < 0.0 && x[W] > slowest)) out[RELEASES] += 1;
      }
    }
  }
  slopes(p, speeds, mu, rows, out[TIME], u, out[SIGN], x, d, &grip);
  return p[RADIUS] * grip;
}
