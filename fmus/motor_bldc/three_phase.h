/* Three phases in star, six-step commutation, floating third phase. Voltages against the middle of the supply. */
#include "core/unit.h"
#include "motor_bldc/constants.h"
#include "motor_bldc/open_bridge.h"

/* trapezoid, eq. 2.17, for x from -2 pi to 2 pi: flat over 120 degrees, +1 from 30 to 150 degrees */
static inline double trapezoid(double x) {
  if (x < 0) x += 2 * PI;
  const double s = x < PI ? x : x - PI, y = clamp(6 / PI * (s < PI / 2 ? s : PI - s), 0, 1);
  return x < PI ? y : -y;
}

/* Tr(theta_e), Tr(theta_e - 2 pi/3), Tr(theta_e - 4 pi/3) of eq. 2.13 to 2.16; theta_e = p phi */
static inline void trapezoids(double theta_e, double shape[3]) {
  const double theta = theta_e - 2 * PI * floor(theta_e / (2 * PI));
  for (int x = 0; x < 3; x++) shape[x] = trapezoid(theta - x * 2 * PI / 3);
}

/* sector n covers theta_e from 30 + 60 n to 90 + 60 n degrees: which phase is high, low, floating (Table 2.2) */
static const int HIGH[6] = {0, 0, 1, 1, 2, 2}, LOW[6] = {1, 2, 2, 0, 0, 1}, FLOATING[6] = {2, 1, 0, 2, 1, 0};
enum { OPEN = 0, TO_SUPPLY = 1, TO_GROUND = -1 };

static inline double sector_start(int n) { return PI / 6 + n * PI / 3; }
static inline int sector_of(double theta_e) { return (int)floor((theta_e - PI / 6) / (PI / 3)); }
static inline int modulo6(int n) { return ((n % 6) + 6) % 6; }

typedef struct {
  double shape[3], e[3], der[3];
  double v_floating; /* of the floating phase; of the star point while the bridge is off */
  double power;      /* from the supply, that of the active legs as at the terminals */
} Phases;

static inline double sum_of_magnitudes(const double i[3]) { return (fabs(i[0]) + fabs(i[1]) + fabs(i[2])) / 2; }

static inline Phases three_phases(const Unit *m, double v, double R, const double i[3]) {
  Phases p;
  const double R_ph = R / 2, L_ph = m->winding_L / 2;
  const int n = modulo6(m->sector[0]), h = HIGH[n], l = LOW[n], f = FLOATING[n];
  /* within its sector two trapezoids are flat and the floating phase's is a line, eq. 2.17 to 2.19 */
  p.shape[h] = 1;
  p.shape[l] = -1;
  p.shape[f] = (n % 2 ? -1 : 1) * (1 - 6 / PI * (electrical_angle(m) - sector_start(m->sector[0])));
  const double i_tau = p.shape[0] * i[0] + p.shape[1] * i[1] + p.shape[2] * i[2]; /* its sign is that of the torque */
  const double k = emf_constant(m, sum_of_magnitudes(i), i_tau * m->w < 0);
  for (int x = 0; x < 3; x++) p.e[x] = k / 2 * m->w * p.shape[x];
  if (!m->enable) {
    p.v_floating = open_bridge(m, R, i, p.e, p.der);
    p.power = -bus_voltage(m) * sum_of_magnitudes(i); /* every current flows back */
    return p;
  }
  double u[3];
  u[h] = v / 2;
  u[l] = -v / 2;
  if (m->diode[0] == OPEN) {
    const double star = -(p.e[h] + p.e[l]) / 2;
    p.v_floating = star + p.e[f];
    p.der[h] = (u[h] - star - p.e[h] - R_ph * i[h]) / L_ph;
    p.der[l] = -p.der[h];
    p.der[f] = 0;
  } else {
    u[f] = m->diode[0] * diode_voltage(m);
    const double star = (u[f] - p.e[0] - p.e[1] - p.e[2]) / 3;
    p.v_floating = u[f];
    for (int x = 0; x < 3; x++) p.der[x] = (u[x] - star - p.e[x] - R_ph * i[x]) / L_ph;
  }
  p.power = u[h] * i[h] + u[l] * i[l] + m->diode[0] * bus_voltage(m) / 2 * i[f];
  return p;
}
