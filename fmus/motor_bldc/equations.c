/* BLDC motor with inverter and drive. The table beside this file has the sources of the terms; the base model, averaged:
 *
 *   L di/dt             = v - R i - k w                    thesis eq. 2.5
 *   (J + J_coupled) dw/dt = k i - tau_f - tau              thesis eq. 2.2
 *
 * constants.h has what k depends on, losses.h what bridge, supply and iron take, foc.h the same in rotor coordinates,
 * switching.h the pulses of the bridge.
 */
#define UNIT_EVENTS
#define UNIT_OBSERVED
#define UNIT_SAMPLED
#define UNIT_TIMED
#include "core/unit.h"

enum { AVERAGED = 1, SIMSCAPE, COMPREHENSIVE, FOC, SWITCHING };
/* the others have one current that gives the torque, x_i, and one voltage that drives it */
static inline bool six_step(const Unit *m) { return m->motor_level == SIMSCAPE || m->motor_level == COMPREHENSIVE; }

#include "friction/friction.h"
#include "motor_bldc/constants.h"
#include "motor_bldc/drive.h"
#include "motor_bldc/foc.h"
#include "motor_bldc/losses.h"
#include "motor_bldc/switching.h"
#include "motor_bldc/three_phase.h"

static const int HALL[6] = {1, 3, 2, 6, 4, 5}; /* H1 + 2*H2 + 4*H3 per sector, Table 2.2 */

static void unit_start(Unit *m) {
  if (m->time == m->start_time) m->sector[0] = sector_of(electrical_angle(m));
  m->lossy[0] = any_loss(m);
  m->der_x_i = m->der_x_ia = m->der_x_ib = m->der_x_d = m->der_q_d = m->v_d = m->v_drive = 0; /* and stay 0 at others */
  start_sliding(m, m->w);
}

static inline double cogging(const Unit *m) {
  return m->cogging_A != 0 ? m->cogging_A * sin(m->cogging_n * m->phi + m->cogging_phi_0) : 0;
}

/* heat of the winding and of the stator's iron; the magnet follows the winding */
static inline void temperatures(Unit *m, double winding, double iron) {
  const double R_th = m->winding_heating_R_th, R_h = m->winding_heating_R_h;
  m->der_rise_h = 0;
  if (R_h > 0 || m->rise_h != 0)
    m->der_rise_h = (R_h * ((R_th > 0 ? m->rise / R_th : winding) + iron) - m->rise_h) / m->winding_heating_T_h;
  m->der_rise = (R_th * winding - m->rise) / m->winding_heating_T - m->der_rise_h;
  m->der_rise_m = m->magnet_beta != 0 ? (m->rise + m->rise_h - m->rise_m) / m->magnet_T : 0;
}

static void unit_equations(Unit *m) {
  const bool phases = six_step(m), foc = m->motor_level == FOC, lossy = m->lossy[0];

  /* winding: R(T_w), eq. 3.1; the line is not one to absolute zero */
  const double T_w = m->winding_heating_T_a + m->rise + m->rise_h;
  const double R = m->winding_R * positive(1 + m->winding_heating_alpha * (T_w - 298.15));

  const int n = phases ? modulo6(m->sector[0]) : 0;
  const double i3[3] = {m->x_ia, m->x_ib, -m->x_ia - m->x_ib};
  const double i = phases ? sum_of_magnitudes(i3) * (i3[HIGH[n]] - i3[LOW[n]] >= 0 ? 1 : -1) : m->x_i;
  const double k = torque_constant(m, i), e = emf_constant(m, i, i * m->w < 0) * m->w;

  /* drive and inverter */
  m->v_dc = bus_voltage(m);
  double v_max = voltage_limit(m, m->v_dc), e_q = e;
  if (foc) d_axis(m, i, R, &v_max, &e_q);
  double v = drive(m, i, e_q, m->winding_R, v_max);
  if (switching(m)) v = chopped(m, v);
  const double v_drive = v;
  if (m->enable) {
    if (lossy) v -= bridge_drop(m, v_drive, i);
    if (m->supply_sag_R_s != 0) v -= m->supply_sag_R_s * i * pow(fabs(v_drive / bus_voltage(m)), m->supply_sag_n);
    if (m->dead_time_V != 0) v -= m->dead_time_V * sgn(i, m->dead_time_i_0);
    v += m->v_add;
  }

  /* L di/dt = v - R i - k w, eq. 2.5; or three phases, eq. 2.9 to 2.16 */
  double tau_e, power = 0, i_square = square(i); /* power from the supply, where somebody asks */
  if (!phases) {
    m->der_x_i = (v - R * i - e_q) / m->winding_L;
    tau_e = k * i;
    if (lossy) power = v * i + (m->enable ? 0 : 2 * m->diode_drop_V_d * fabs(i));
    if (foc) {
      power += (m->v_d + d_drop(m)) * m->x_d;
      i_square += square(m->x_d);
      sinusoids(m, i, e);
    }
  } else {
    const Phases p = three_phases(m, v, R, i3);
    m->der_x_ia = p.der[0];
    m->der_x_ib = p.der[1];
    tau_e = 0;
    power = p.power;
    for (int x = 0; x < 3; x++) tau_e += k / 2 * p.shape[x] * i3[x];
    m->e_a = p.e[0];
    m->e_b = p.e[1];
    m->e_c = p.e[2];
  }

  /* (J + J_coupled) dw/dt = tau_e - tau_f - tau, eq. 2.2 */
  double tau_f = friction(m, m->w, 0);
  if (m->motor_level == COMPREHENSIVE)
    tau_f += m->friction_d * m->w * m->viscous_dynamic_D * exp(-fabs(m->w) / m->viscous_dynamic_w_D);
  const double tau_Fe = lossy ? iron_torque(m) : 0;
  tau_f += cogging(m) + tau_Fe;
  m->der_w = held_by_friction(m) ? 0 : (tau_e - tau_f - m->tau + m->tau_add) / (m->rotor_J + m->J_coupled);
  m->der_phi = m->w;
  temperatures(m, R * (i_square + (lossy && m->enable ? ripple_square(m, v_drive) : 0)), tau_Fe * m->w);
  m->der_surge = lossy ? surge_rate(m, power + (m->enable ? (v_drive - v) * i : 0)) : 0;

  const bool averages = m->drive_T_i > 0;
  m->der_x_r = averages ? (i - m->x_r) / m->drive_T_i : 0;
  m->i = i;
  m->i_reading = averages ? m->x_r : i;
  m->tau_e = tau_e;
  m->v = v;
  m->T_w = T_w;
  if (phases) {
    m->i_a = i3[0];
    m->i_b = i3[1];
    m->i_c = i3[2];
  }
}

/* counts in quadrature that the encoder's electronics have seen; those above its highest frequency are lost */
static double encoder_counts(const Unit *m) { return floor(4 * m->encoder_lines * m->phi / (2 * PI)) - m->lost[0]; }

/* what only an observer needs: phase quantities of the DC equivalent, Hall code, encoder */
static void unit_observe(Unit *m) {
  const int n = modulo6(six_step(m) ? m->sector[0] : sector_of(electrical_angle(m)));
  if (m->motor_level == AVERAGED || switching(m)) {
    const int high = HIGH[n], low = LOW[n]; /* no array: its parts would have to be stored before it could be read */
    double shape[3];
    m->i_a = high == 0 ? m->x_i : low == 0 ? -m->x_i : 0;
    m->i_b = high == 1 ? m->x_i : low == 1 ? -m->x_i : 0;
    m->i_c = high == 2 ? m->x_i : low == 2 ? -m->x_i : 0;
    trapezoids(electrical_angle(m), shape);
    const double e = emf_constant(m, m->x_i, m->x_i * m->w < 0) / 2 * m->w;
    m->e_a = e * shape[0];
    m->e_b = e * shape[1];
    m->e_c = e * shape[2];
  }
  m->hall = HALL[n];
  m->H1 = m->hall & 1;
  m->H2 = m->hall >> 1 & 1;
  m->H3 = m->hall >> 2 & 1;

  const double count = encoder_counts(m), turn = 4.0 * m->encoder_lines;
  m->encoder_count = (int)fmod(count, 2147483648.0);
  m->encoder_index = count - turn * floor(count / turn) == 0;
}

/* the drive's reading of the speed: counts since the last communication point, filtered */
static void unit_sample(Unit *m) {
  const double dt = m->time - m->counted[1], before = m->counted[0];
  if (m->time > m->start_time && dt > 0) {
    const double most = floor(4 * m->encoder_f_max * dt), seen = encoder_counts(m) - before;
    if (fabs(seen) > most) m->lost[0] += seen - copysign(most, seen);
    const double w = (encoder_counts(m) - before) * 2 * PI / (4 * m->encoder_lines) / dt;
    m->w_reading += (1 - exp(-dt / m->drive_T_w)) * (w - m->w_reading);
  }
  m->counted[0] = encoder_counts(m);
  m->counted[1] = m->time;
}

static void phase_currents(const Unit *m, double i[3]) {
  const bool phases = six_step(m);
  i[0] = phases ? m->x_ia : m->x_i;
  i[1] = phases ? m->x_ib : 0;
  i[2] = phases ? -m->x_ia - m->x_ib : 0;
}

static void open_bridge_indicators(const Unit *m, double z[N_EVENT]) {
  int leg, side, high, low;
  double i[3];
  phase_currents(m, i);
  if (!six_step(m)) {
    z[EVENT_leg_opens] = ending(m, i, 1, &leg);
    if (m->leg[0] == 0) z[EVENT_leg_conducts] = fabs(emf_constant(m, 0, false) * m->w) - 2 * diode_voltage(m);
    return;
  }
  const Phases p = three_phases(m, 0, m->winding_R, i);
  z[EVENT_leg_opens] = ending(m, i, 3, &leg);
  if (!isnan(p.v_floating)) {
    z[EVENT_leg_conducts] = beyond(m, p.v_floating, p.e, &leg, &side);
  } else {
    largest_and_smallest(p.e, &high, &low);
    z[EVENT_leg_conducts] = p.e[high] - p.e[low] - 2 * diode_voltage(m);
  }
}

/* torque on the rotor, friction that slides apart */
static inline double on_the_shaft(const Unit *m) {
  const double bristles = m->presliding_share != 0 ? sqrt(m->presliding_share * m->friction_tau_C) * m->z : 0;
  return m->tau_e - cogging(m) - bristles - m->tau + m->tau_add;
}

static void unit_indicators(const Unit *m, double z[N_EVENT]) {
  for (int k = 0; k < N_EVENT; k++) z[k] = -1;
  if (m->off[0] == (m->enable != 0)) {
    z[EVENT_bridge] = 1;
    return;
  }
  stick_indicators(m, m->w, on_the_shaft(m), z);
  if (m->off[0]) open_bridge_indicators(m, z);
  if (!six_step(m)) return;
  z[EVENT_forward] = electrical_angle(m) - sector_start(m->sector[0] + 1);
  z[EVENT_backward] = sector_start(m->sector[0]) - electrical_angle(m);
  if (m->off[0]) return;
  double i3[3];
  phase_currents(m, i3);
  const int f = FLOATING[modulo6(m->sector[0])];
  if (m->diode[0] == OPEN) {
    const double edge = diode_voltage(m);
    const double e[3] = {m->e_a, m->e_b, m->e_c}, v_f = 1.5 * e[f] - (e[0] + e[1] + e[2]) / 2; /* e_f - (e_h + e_l)/2 */
    z[EVENT_diode_high] = v_f - edge;
    z[EVENT_diode_low] = -edge - v_f;
  } else {
    z[EVENT_freewheel_end] = m->diode[0] == TO_GROUND ? -i3[f] : i3[f];
  }
}

static void set_current_to_zero(Unit *m, int x) {
  const double half = (x == 0 ? m->x_ia : x == 1 ? m->x_ib : -m->x_ia - m->x_ib) / 2;
  m->x_ia = x == 0 ? 0 : m->x_ia + half;
  m->x_ib = x == 1 ? 0 : x == 2 ? -m->x_ia : m->x_ib + half;
}

/* the phase that opens keeps its current on a diode */
static void open_floating_phase(Unit *m) {
  double i3[3];
  phase_currents(m, i3);
  const int f = FLOATING[modulo6(m->sector[0])];
  m->diode[0] = fabs(i3[f]) < 1e-12 ? OPEN : i3[f] > 0 ? TO_GROUND : TO_SUPPLY;
  if (m->diode[0] == OPEN) set_current_to_zero(m, f);
}

static void switch_bridge(Unit *m) {
  double i[3];
  phase_currents(m, i);
  m->off[0] = !m->enable;
  if (m->off[0]) m->chopper[0] = IDLE;
  for (int x = 0; x < 3; x++) m->leg[x] = m->off[0] ? leg_of(i[x]) : 0;
  m->q_i = m->q_d = m->x_d = 0;
  if (!m->off[0] && six_step(m)) open_floating_phase(m);
}

static void open_leg(Unit *m) {
  int x = 0;
  double i[3];
  phase_currents(m, i);
  ending(m, i, six_step(m) ? 3 : 1, &x);
  m->leg[x] = 0;
  if (!six_step(m)) {
    m->x_i = 0;
    return;
  }
  set_current_to_zero(m, x);
  if ((m->leg[0] != 0) + (m->leg[1] != 0) + (m->leg[2] != 0) < 2) /* a single leg carries nothing */
    m->leg[0] = m->leg[1] = m->leg[2] = 0, m->x_ia = m->x_ib = 0;
}

static void turn_on_diode(Unit *m) {
  if (!six_step(m)) {
    m->leg[0] = m->w > 0 ? 1 : -1;
    return;
  }
  int x = 0, side = 0, high, low;
  double i[3];
  phase_currents(m, i);
  const Phases p = three_phases(m, 0, m->winding_R, i);
  if (!isnan(p.v_floating)) {
    beyond(m, p.v_floating, p.e, &x, &side);
    m->leg[x] = side;
  } else {
    largest_and_smallest(p.e, &high, &low);
    m->leg[high] = 1;
    m->leg[low] = -1;
  }
}

static void unit_event(Unit *m, int event) {
  switch (event) {
    case EVENT_bridge: switch_bridge(m); break;
    case EVENT_leg_opens: open_leg(m); break;
    case EVENT_leg_conducts: turn_on_diode(m); break;
    case EVENT_comes_to_rest: m->w = m->sliding[0] = 0; break;
    case EVENT_breaks_away: m->sliding[0] = on_the_shaft(m) > 0 ? 1 : -1; break;
    case EVENT_diode_high: m->diode[0] = TO_SUPPLY; break;
    case EVENT_diode_low: m->diode[0] = TO_GROUND; break;
    case EVENT_freewheel_end:
      m->diode[0] = OPEN;
      set_current_to_zero(m, FLOATING[modulo6(m->sector[0])]);
      break;
    default: /* commutation */
      m->sector[0] += event == EVENT_forward ? 1 : -1;
      if (!m->off[0]) open_floating_phase(m);
  }
}
