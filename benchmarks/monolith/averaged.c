/* The whole bench with the averaged motor in one loop: classical Runge-Kutta, fixed step. */
#include "bench.h"

enum { I = MECHANICAL_STATES, STATES };

/* i_motor, w_motor, phi_motor, tau_gear, tau_sensor, w_pulley, phi_pulley, w_brake, tau_belt */
enum { COLUMNS = 9 };

static inline torques derivatives(setup set_up, const double x[], inputs u, double der[]) {
  der[I] = (u.v - R * x[I] - k * x[W]) / L;
  return mechanics(set_up, x, u, k * x[I], der);
}

static void record(setup set_up, const double x[], inputs u, double row[]) {
  double der[STATES];
  const torques shaft = derivatives(set_up, x, u, der);
  const double loaded = set_up == LOADED;

  row[0] = x[I];
  row[1] = x[W];
  row[2] = x[PHI];
  row[3] = shaft.tau_g;
  row[4] = shaft.tau_s;
  row[5] = loaded * x[W_P];
  row[6] = loaded * x[PHI_P];
  row[7] = loaded * x[W_B];
  row[8] = shaft.tau_belt;
}

/* Simulates from rest over rows - 1 samples of 1 ms, steps_per_sample steps each, and fills results[rows][COLUMNS]. */
void averaged_run(setup set_up, int steps_per_sample, size_t rows, const inputs u[], double results[]) {
  const double h = 1e-3 / steps_per_sample;
  double x[STATES] = {0}, y[STATES], k1[STATES], k2[STATES], k3[STATES], k4[STATES];

  record(set_up, x, u[0], results);
  for (size_t row = 0; row + 1 < rows; row++) {
    for (int step = 0; step < steps_per_sample; step++) {
      const inputs start = interpolate(&u[row], (double)step / steps_per_sample);
      const inputs middle = interpolate(&u[row], (step + 0.5) / steps_per_sample);
      const inputs end = interpolate(&u[row], (step + 1.0) / steps_per_sample);

      derivatives(set_up, x, start, k1);
      for (int n = 0; n < STATES; n++) y[n] = x[n] + 0.5 * h * k1[n];
      derivatives(set_up, y, middle, k2);
      for (int n = 0; n < STATES; n++) y[n] = x[n] + 0.5 * h * k2[n];
      derivatives(set_up, y, middle, k3);
      for (int n = 0; n < STATES; n++) y[n] = x[n] + h * k3[n];
      derivatives(set_up, y, end, k4);
      for (int n = 0; n < STATES; n++) x[n] += h / 6.0 * (k1[n] + 2.0 * k2[n] + 2.0 * k3[n] + k4[n]);
    }
    record(set_up, x, u[row + 1], &results[(row + 1) * COLUMNS]);
  }
}
