/* How a unit gets from one communication point to the next: explicit Runge-Kutta of order 3 with an embedded error
 * estimate (Bogacki and Shampine 1989, "A 3(2) pair of Runge-Kutta formulas", Appl. Math. Lett. 2(4)), steps chosen by
 * the error, events located on the cubic Hermite interpolant and then stepped onto. Knows no physics. */
#ifndef COBOT_JOINT_INTEGRATE_H
#define COBOT_JOINT_INTEGRATE_H

#include <string.h>

#include "core/table.h"
#include "core/unit.h"

enum { N_X1 = N_X > 0 ? N_X : 1, N_EVENT1 = N_EVENT > 0 ? N_EVENT : 1, MAX_STEPS = 5000000 };

/* the input's polynomial begins here, as a constant */
static inline void begin_input(Unit *m, int j, double value) {
  m->u[j].t0 = m->time;
  m->u[j].c[0] = value;
  for (int k = 1; k <= INPUT_ORDER; k++) m->u[j].c[k] = 0;
  m->u[j].order = 0;
  m->u[j].fresh = 1;
  m->u[j].given = m->u[j].answers = 0;
}

/* u(t) = c0 + c1 (t-t0) + c2 (t-t0)^2/2 + c3 (t-t0)^3/6 for the inputs that move (FMI 2.0, 4.2.1) */
static inline void inputs_at(Unit *m, double t) {
  for (int j = 0; j < N_INPUT; j++) {
    if (m->u[j].order == 0) continue;
    const double s = t - m->u[j].t0, *c = m->u[j].c;
    reals(m)[FIRST_INPUT + j] = c[0] + s * (c[1] + s / 2 * (c[2] + s / 3 * c[3]));
  }
}

static const struct {
  int tau, phi, w, sign;
} HELD[N_HELD + 1] = {
#define gives +1
#define takes -1
#define HELD_TORQUE(tau, phi, w, role, ...) {VR_##tau, VR_##phi, VR_##w, role},
#include "core/rows.h"
#undef gives
#undef takes
    {0, 0, 0, 0}};

/* what the neighbour's spring adds to a held torque: held.h has the equation */
static inline void answers_at(Unit *m, double t) {
  for (int n = 0; n < N_HELD; n++) {
    if (!m->u[HELD[n].tau - FIRST_INPUT].answers) continue;
    const Anchor *q = &m->anchor[n];
    const double e = reals(m)[HELD[n].phi] - q->phi - q->w * (t - q->t0), de = reals(m)[HELD[n].w] - q->w;
    reals(m)[HELD[n].tau] += HELD[n].sign * (q->C * e + q->D * de);
  }
}

/* equations, and the power through every mechanical port, of which the work is the integral */
static inline void equations(Unit *m) {
  unit_equations(m);
#define FLANGE(name, phi, w, tau, W, W_abs, role)                                                                      \
  m->der_##W = m->tau * m->w;                                                                                          \
  m->der_##W_abs = fabs(m->der_##W);
#include "core/rows.h"
}

static inline void evaluate(Unit *m, double t) {
  m->time = t;
  inputs_at(m, t);
  answers_at(m, t);
  equations(m);
}

/* outputs that only a reader wants; the integrator does without */
static inline void observe(Unit *m) {
  (void)m;
#if defined UNIT_OBSERVED
  unit_observe(m);
#endif
}

static inline void evaluate_outputs(Unit *m, double t) {
  evaluate(m, t);
  observe(m);
}

#if defined UNIT_EVENTS
static inline bool event_pending(const Unit *m, double z[]) {
  bool any = false;
  unit_indicators(m, z);
  for (int k = 0; k < N_EVENT; k++) any |= z[k] > 0;
  return any;
}

/* all events that are due at the present point; one may call up the next */
static bool events_here(Unit *m) {
  double z[N_EVENT1];
  for (int n = 0; n < 64; n++) {
    if (!event_pending(m, z)) return true;
    for (int k = 0; k < N_EVENT; k++)
      if (z[k] > 0) {
        m->happened[k].count++;
        m->happened[k].last = m->time;
        unit_event(m, k);
      }
    evaluate(m, m->time);
  }
  return false;
}
#endif

/* the unit's own time events that are due at the present point */
static inline void time_events_here(Unit *m) {
  (void)m;
#if defined UNIT_TIMED
  while (unit_next_time(m) - m->time <= 1e-13 * fmax(1, fabs(m->time))) {
    unit_time_event(m);
    evaluate(m, m->time);
  }
#endif
}

/* t_end, or the unit's own time event that comes before it */
static inline double next_stop(const Unit *m, double t_end) {
  (void)m;
#if defined UNIT_TIMED
  const double next = unit_next_time(m);
  if (next < t_end) return next > m->time ? next : m->time;
#endif
  return t_end;
}

/* how large each state is, the other way round */
static const double OVER_NOMINAL[N_STATE + 1] = {
#define STATE(name, unit, nominal, ...) 1 / (double)(nominal),
#include "core/rows.h"
    0};

/* one step of length h from (t, x0) with k1 known; leaves the end point evaluated in m and returns the error norm */
static inline double rk_step(Unit *m, double t, double h, const double x0[], const double k1[]) {
  double k2[N_X1], k3[N_X1], *x = reals(m);
  const double *der = reals(m) + FIRST_DER;
  for (int i = 0; i < N_X; i++) x[i] = x0[i] + h / 2 * k1[i];
  evaluate(m, t + h / 2);
  for (int i = 0; i < N_X; i++) x[i] = x0[i] + h * 3 / 4 * (k2[i] = der[i]);
  evaluate(m, t + h * 3 / 4);
  for (int i = 0; i < N_X; i++) x[i] = x0[i] + h / 9 * (2 * k1[i] + 3 * k2[i] + 4 * (k3[i] = der[i]));
  evaluate(m, t + h);
  double worst = 0;
  bool lost = false; /* a number among them that is none */
  for (int i = 0; i < N_STATE; i++) {
    const double e = h / 72 * (-5 * k1[i] + 6 * k2[i] + 8 * k3[i] - 9 * der[i]);
    const double r = fabs(e) * OVER_NOMINAL[i];
    worst = r > worst ? r : worst;
    lost |= !(r <= DBL_MAX);
  }
  return lost ? INFINITY : worst / m->tolerance;
}

#if defined UNIT_EVENTS
/* the largest indicator at the share s of the step just taken, on the cubic Hermite interpolant; positive: an event is due */
static double indicator_at(Unit *probe, double s, double t, double h, const double x0[], const double k1[],
                           const Unit *end) {
  const double *x1 = reals(end), *k4 = reals(end) + FIRST_DER;
  double z[N_EVENT1], largest = -DBL_MAX;
  for (int i = 0; i < N_X; i++) {
    const double d = x1[i] - x0[i];
    reals(probe)[i] = x0[i] + s * d + s * (s - 1) * ((1 - 2 * s) * d + (s - 1) * h * k1[i] + s * h * k4[i]);
  }
  evaluate(probe, t + s * h);
  unit_indicators(probe, z);
  for (int k = 0; k < N_EVENT; k++) largest = fmax(largest, z[k]);
  return largest;
}

/* Where in (0, 1] of the step just taken the first event lies, just behind its root: regula falsi with Illinois' halving
 * (Dowell and Jarratt 1971, BIT 11), and a bisection after every three that leave most of the bracket. */
static double first_event(const Unit *m, double t, double h, const double x0[], const double k1[]) {
  const double enough = 1e-12 / h;
  Unit probe = *m;
  double low = 0, high = 1, z_low = indicator_at(&probe, 0, t, h, x0, k1, m),
         z_high = indicator_at(&probe, 1, t, h, x0, k1, m);
  if (z_low > 0) return enough < 1 ? enough : 1; /* due from the start: events_here was not asked since */
  double width = 1;
  for (int n = 0, kept = 0; n < 100 && high - low > enough; n++) {
    double s = high - z_high * (high - low) / (z_high - z_low);
    if (n % 4 == 3 && high - low > width / 2) s = (low + high) / 2;
    if (n % 4 == 3) width = high - low;
    s = clamp(s, low + enough / 4, high - enough / 4); /* never onto an end: the bracket closes from both sides */
    const double z = indicator_at(&probe, s, t, h, x0, k1, m);
    if (z > 0) {
      high = s, z_high = z;
      if (kept > 0) z_low /= 2;
      kept = kept > 0 ? kept + 1 : 1;
    } else {
      low = s, z_low = z;
      if (kept < 0) z_high /= 2;
      kept = kept < 0 ? kept - 1 : -1;
    }
  }
  return high;
}
#endif

/* what a unit does once per communication point; not where the master ends a step before that, or has a clock for it */
static inline void end_of_step(Unit *m, bool early) {
  (void)m, (void)early;
#if defined UNIT_SAMPLED
  if (!early && !m->clocked) unit_sample(m);
#endif
  observe(m);
}

/* What a master wants of the inside of a step: FMI 3.0's intermediate update and early return. */
typedef struct Watch Watch;
struct Watch {
  void (*step_finished)(Watch *,
                        double t); /* after each step of the integrator; leaves the unit evaluated, may lower `until` */
  bool at_events;                  /* stop at an event that is due, and leave it to the master */
  bool event_due;                  /* stopped so */
  double until;                    /* s, where the step ends */
};

static inline double look(Watch *watch, const Unit *m, double t_end) {
  if (watch->step_finished) watch->step_finished(watch, m->time);
  return fmin(t_end, watch->until);
}

/* whether the step ends at an event, at t: it is the master's */
static inline bool leaves_event(Watch *watch, double t) {
  if (!watch || !watch->at_events) return false;
  watch->event_due = true;
  watch->until = t;
  return true;
}

/* From m->time to t_end, or where the watch (NULL: there is none) ends it. Returns NULL, or why it could not be done. */
static const char *integrate(Unit *m, double t_end, Watch *watch) {
  if (m->stale) evaluate(m, m->time);
  m->stale = 0;
#if defined UNIT_EVENTS
  if (!events_here(m)) return "events follow each other without end";
#endif
  time_events_here(m);
  if (N_X == 0) {
    evaluate(m, t_end);
    if (watch) look(watch, m, t_end);
    return NULL;
  }
  double t = m->time, x0[N_X1], k1[N_X1];
  const double *der = reals(m) + FIRST_DER, shortest = 1e-13 * fmax(1, fabs(t_end));
  for (int n = 0; n < MAX_STEPS; n++) {
    const double stop = next_stop(m, t_end), left = stop - t;
    if (left <= shortest) {
      if (m->time != stop) t = m->time = stop;
      if (stop >= t_end || leaves_event(watch, stop)) return NULL;
      time_events_here(m);
      continue;
    }
    /* the last step ends on t_end; the one before it is halved with it rather than leaving a crumb */
    double h = m->step >= left ? left : m->step > left / 2 ? left / 2 : m->step;
    bool last = h >= left;
    memcpy(x0, reals(m), sizeof(double) * N_X);
    memcpy(k1, der, sizeof(double) * N_X);
    double error = rk_step(m, t, h, x0, k1);
#if defined UNIT_EVENTS
    double z[N_EVENT1];
    if (error <= 1 && event_pending(m, z)) {
      const double s = first_event(m, t, h, x0, k1);
      if (s < 1) { /* the step ends behind the event: rounding may want it longer, or the event would never come */
        const double whole = h;
        double more = 0;
        do {
          h = fmin(whole * s + more, whole);
          memcpy(reals(m), x0, sizeof(double) * N_X);
          error = rk_step(m, t, h, x0, k1);
          more = fmax(2 * more, 1e-13);
        } while (h < whole && !event_pending(m, z));
        last = last && h >= whole;
      }
    }
#endif
    if (!(error <= 1)) { /* too large, or not a number: back, and smaller */
      memcpy(reals(m), x0, sizeof(double) * N_X);
      m->step = h * (error < 1e9 ? fmax(0.2, 0.9 / cbrt(error)) : 0.1);
      if (m->step < shortest) {
        evaluate(m, t);
        return "the step size went to zero";
      }
      evaluate(m, t);
      continue;
    }
    t = last ? stop : t + h;
    m->time = t;
    const double next = h * (error < 0.18 * 0.18 * 0.18 ? 5 : 0.9 / cbrt(error));
    m->step = h < m->step ? fmax(m->step, next) : next; /* a step cut short says nothing against longer ones */
#if defined UNIT_EVENTS
    if (watch && watch->at_events && event_pending(m, z) && leaves_event(watch, t)) return NULL;
    if (!events_here(m)) return "events follow each other without end";
#endif
    if (watch) t_end = look(watch, m, t_end);
  }
  return "too many steps";
}

#endif
