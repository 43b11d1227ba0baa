/* The whole bench with the three-phase motor in one loop: trapezoidal back-EMF, six-step commutation, freewheeling
 * diodes and a floating phase; classical Runge-Kutta, fixed step, as the thesis ran it. With locate, a step that
 * crosses an event is cut there: far more accurate, and the yardstick for everybody's phase currents. */
#include <stdbool.h>

#include "bench.h"

enum { I_A = MECHANICAL_STATES, I_B, I_C, Q, STATES }; /* Q: integral of the drive's current */

/* i_motor, w_motor, phi_motor, tau_gear, tau_sensor, w_pulley, phi_pulley, w_brake, tau_belt, i_a, i_b, i_c, Q */
enum { COLUMNS = 13 };

static const double bus = 24.0, pi = 3.14159265358979323846;

/* What holds until the next event. */
typedef struct {
  int upper, lower, floating; /* phases: v at bus/2 + v/2, at bus/2 - v/2, at no switch */
  int diode;                  /* of the floating phase: +1 lower one feeds i > 0, -1 upper one drains i < 0, 0 none */
  int sector;                 /* of the Hall sensors: theta_e in [30 deg + 60 deg sector, + 60 deg) */
  int contact;                /* of the gearhead's gap: -1, 0, +1 */
} mode;

/* Eq. 2.17: trapezoid of unit height */
static double Tr(double theta) {
  theta -= 2.0 * pi * floor(theta / (2.0 * pi));
  if (theta < pi / 6.0) return 6.0 / pi * theta;
  if (theta < 5.0 * pi / 6.0) return 1.0;
  if (theta < 7.0 * pi / 6.0) return 6.0 - 6.0 / pi * theta;
  if (theta < 11.0 * pi / 6.0) return -1.0;
  return 6.0 / pi * theta - 12.0;
}

/* Table 2.2 with theta_e = theta_table + 30 deg: the sector's phases (upper, lower, floating). */
static const int switched[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 2, 0}, {1, 0, 2}, {2, 0, 1}, {2, 1, 0}};

/* Phase voltages against the bus's minus, Tr of each phase, and the voltage of the star point. */
static double voltages(const double x[], inputs u, const mode *now, double v[3], double tr[3]) {
  double e[3];

  for (int n = 0; n < 3; n++) { /* eq. 2.13-2.15, k = k_e, one pole pair */
    tr[n] = Tr(x[PHI] - n * 2.0 * pi / 3.0);
    e[n] = 0.5 * k * x[W] * tr[n];
  }
  v[now->upper] = 0.5 * (bus + u.v);
  v[now->lower] = 0.5 * (bus - u.v);
  if (now->diode) {
    v[now->floating] = now->diode > 0 ? 0.0 : bus;
    return (v[0] + v[1] + v[2] - e[0] - e[1] - e[2]) / 3.0;
  }
  const double star = 0.5 * (bus - e[now->upper] - e[now->lower]);
  v[now->floating] = star + e[now->floating];
  return star;
}

static double drive_current(const double x[], const mode *now) {
  return 0.5 * (x[I_A + now->upper] - x[I_A + now->lower]);
}

static torques derivatives(setup set_up, const double x[], inputs u, const mode *now, double der[]) {
  double v[3], tr[3], tau_e = 0.0;
  const double star = voltages(x, u, now, v, tr);

  for (int n = 0; n < 3; n++) {
    /* phase: L/2 di/dt = v - v_star - R/2 i - e */
    der[I_A + n] = (v[n] - star - 0.5 * R * x[I_A + n] - 0.5 * k * x[W] * tr[n]) / (0.5 * L);
    tau_e += 0.5 * k * tr[n] * x[I_A + n]; /* eq. 2.16 */
  }
  if (!now->diode) der[I_A + now->floating] = 0.0;
  der[Q] = drive_current(x, now);
  return mechanics(set_up, x, u, tau_e, der);
}

static double gap(const double x[]) { return x[PHI] / N - x[PHI_O]; }

/* What leaves the mode when it turns negative: the floating phase's current or its voltage's distance to the bus,
 * the rotor's way to the next Hall edge, and the gap's contact. */
enum { EVENTS = 4 };

static void indicators(setup set_up, const double x[], inputs u, const mode *now, double z[EVENTS]) {
  double v[3], tr[3];
  const double theta = x[PHI] - pi / 6.0 - now->sector * pi / 3.0, delta = gap(x);

  voltages(x, u, now, v, tr);
  if (now->diode)
    z[0] = now->diode * x[I_A + now->floating];
  else
    z[0] = fmin(v[now->floating], bus - v[now->floating]);
  z[1] = theta;
  z[2] = pi / 3.0 - theta;
  z[3] = 1.0;
  if (set_up != MOTOR_ALONE) z[3] = now->contact ? now->contact * delta - 0.5 * b : 0.5 * b - fabs(delta);
}

/* The mode that begins at x. A current below i_zero A counts as none. */
static void enter_mode(double x[], inputs u, mode *now, double i_zero) {
  double v[3], tr[3];
  const double delta = gap(x);

  now->sector = (int)floor((x[PHI] - pi / 6.0) / (pi / 3.0));
  const int *row = switched[((now->sector % 6) + 6) % 6];
  now->upper = row[0], now->lower = row[1], now->floating = row[2];
  now->contact = delta > 0.5 * b ? 1 : delta < -0.5 * b ? -1 : 0;

  const double i = x[I_A + now->floating];
  if (fabs(i) > i_zero) {
    now->diode = i > 0.0 ? 1 : -1;
    return;
  }
  x[I_A + now->floating] = 0.0; /* what rounding left goes to the other two: the sum stays zero */
  x[I_A + now->upper] += 0.5 * i;
  x[I_A + now->lower] += 0.5 * i;
  now->diode = 0;
  voltages(x, u, now, v, tr);
  if (v[now->floating] < 0.0)
    now->diode = 1;
  else if (v[now->floating] > bus)
    now->diode = -1;
}

static void runge_kutta(setup set_up, double x[], const inputs u[], double s, double h, const mode *now) {
  const double samples = h / 1e-3; /* h as a share of the inputs' interval */
  const inputs start = interpolate(u, s), middle = interpolate(u, s + 0.5 * samples);
  const inputs end = interpolate(u, s + samples);
  double y[STATES], k1[STATES], k2[STATES], k3[STATES], k4[STATES];

  derivatives(set_up, x, start, now, k1);
  for (int n = 0; n < STATES; n++) y[n] = x[n] + 0.5 * h * k1[n];
  derivatives(set_up, y, middle, now, k2);
  for (int n = 0; n < STATES; n++) y[n] = x[n] + 0.5 * h * k2[n];
  derivatives(set_up, y, middle, now, k3);
  for (int n = 0; n < STATES; n++) y[n] = x[n] + h * k3[n];
  derivatives(set_up, y, end, now, k4);
  for (int n = 0; n < STATES; n++) x[n] += h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n]);
}

/* One fixed step as the thesis made it: switches and diodes are looked at between steps only. */
static void fixed_step(setup set_up, double x[], const inputs u[], double s, double h, mode *now) {
  const int freewheeling = now->diode, was_floating = now->floating;

  runge_kutta(set_up, x, u, s, h, now);
  const bool ended = freewheeling && freewheeling * x[I_A + was_floating] <= 0.0;
  enter_mode(x, interpolate(u, s + h / 1e-3), now, ended ? HUGE_VAL : 0.0);
}

static bool left(setup set_up, const double x[], inputs u, const mode *now) {
  double z[EVENTS];
  bool out = false;

  indicators(set_up, x, u, now, z);
  for (int n = 0; n < EVENTS; n++) out = out || z[n] < 0.0;
  return out;
}

/* One step cut at its events by bisection to a picosecond. */
static void located_step(setup set_up, double x[], const inputs u[], double s, double h, mode *now) {
  double y[STATES];

  while (h > 0.0) {
    double good = 0.0, bad = h;

    for (int n = 0; n < STATES; n++) y[n] = x[n];
    runge_kutta(set_up, y, u, s, h, now);
    if (!left(set_up, y, interpolate(u, s + h / 1e-3), now)) {
      for (int n = 0; n < STATES; n++) x[n] = y[n];
      return;
    }
    while (bad - good > 1e-12) {
      const double trial = 0.5 * (good + bad);

      for (int n = 0; n < STATES; n++) y[n] = x[n];
      runge_kutta(set_up, y, u, s, trial, now);
      if (left(set_up, y, interpolate(u, s + trial / 1e-3), now))
        bad = trial;
      else
        good = trial;
    }
    runge_kutta(set_up, x, u, s, bad, now); /* just past the event, so that it has happened */
    s += bad / 1e-3;
    h -= bad;
    enter_mode(x, interpolate(u, s), now, 1e-6);
  }
}

static void record(setup set_up, const double x[], inputs u, const mode *now, double row[]) {
  double der[STATES];
  const torques shaft = derivatives(set_up, x, u, now, der);
  const double loaded = set_up == LOADED;
  const double values[COLUMNS] = {drive_current(x, now),
                                  x[W],
                                  x[PHI],
                                  shaft.tau_g,
                                  shaft.tau_s,
                                  loaded * x[W_P],
                                  loaded * x[PHI_P],
                                  loaded * x[W_B],
                                  shaft.tau_belt,
                                  x[I_A],
                                  x[I_B],
                                  x[I_C],
                                  x[Q]};

  for (int n = 0; n < COLUMNS; n++) row[n] = values[n];
}

/* Simulates from rest over rows - 1 samples of 1 ms, steps_per_sample steps each, and fills results[rows][COLUMNS]. */
void three_phase_run(setup set_up, int steps_per_sample, int locate, size_t rows, const inputs u[], double results[]) {
  const double h = 1e-3 / steps_per_sample;
  double x[STATES] = {0};
  mode now = {0};

  enter_mode(x, u[0], &now, 0.0);
  record(set_up, x, u[0], &now, results);
  for (size_t row = 0; row + 1 < rows; row++) {
    for (int step = 0; step < steps_per_sample; step++) {
      const double s = (double)step / steps_per_sample;

      if (locate)
        located_step(set_up, x, &u[row], s, h, &now);
      else
        fixed_step(set_up, x, &u[row], s, h, &now);
    }
    record(set_up, x, u[row + 1], &now, &results[(row + 1) * COLUMNS]);
  }
}
