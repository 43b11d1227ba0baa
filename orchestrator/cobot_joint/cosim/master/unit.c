/* What the master does with one unit: FMI calls, and what is said when one fails. */
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>

#include "master.h"

enum { MAX_ORDER = 3 };
static const double LAST_STAIR = 1e-3; /* of a step */

static const char *word(fmi2Status status) {
  static const char *const words[] = {"ok", "warning", "discard", "error", "fatal", "pending"};
  return status >= fmi2OK && status <= fmi2Pending ? words[status] : "an unknown status";
}

static int fail(Master *m, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(m->message, sizeof m->message, format, arguments);
  va_end(arguments);
  return -1;
}

/* 0: go on; -1: the message says which unit, which call, at what time */
static inline int check(Master *m, const Unit *unit, const char *call, fmi2Status status) {
  if (status == fmi2OK) return 0;
  if (status == fmi2Warning) {
    m->count.warnings++;
    return 0;
  }
  return fail(m, "%s: %s returned %s at t = %.9g s", unit->name, call, word(status), time_of(m, m->tick));
}

static inline Polynomial through(const Master *m, const Wire *wire, double s) {
  Polynomial p = s == 0 ? m->p[wire->signal] : shifted(&m->p[wire->signal], s);
  for (int k = 0; k <= MAX_ORDER; k++) p.a[k] *= wire->factor;
  p.a[0] += wire->offset;
  return p;
}

static int set_real_inputs(Master *m, const Unit *unit, const Scratch *scratch, double s, double h) {
  size_t n = unit->real_inputs.n;
  if (n == 0) return 0;
  double at = unit->input_order > 0 ? 0 : unit->holds_end ? h : 0.5 * h;
  for (size_t j = 0; j < n; j++) {
    Polynomial p = through(m, &unit->wires[j], s);
    m->u[j] = value(&p, at);
    if (unit->input_order == 1) {
      m->du[j] = (value(&p, h) - p.a[0]) / h;
    } else if (unit->input_order == 3) {
      m->du[3 * j] = p.a[1];
      m->du[3 * j + 1] = 2 * p.a[2];
      m->du[3 * j + 2] = 6 * p.a[3];
    }
  }
  if (check(m, unit, "fmi2SetReal", unit->set_real(unit->component, unit->real_inputs.refs, n, m->u))) return -1;
  if (unit->input_order == 0) return 0;
  size_t n_derivatives = n * (size_t)unit->input_order;
  return check(m, unit, "fmi2SetRealInputDerivatives",
               unit->set_real_input_derivatives(unit->component, scratch->refs, n_derivatives, scratch->orders, m->du));
}

/* Integers and Booleans: the value at the step's begin, or the one just computed by a unit before */
int set_discrete_inputs(Master *m, const Unit *unit) {
  const Wire *wires = unit->wires + unit->real_inputs.n;
  for (size_t j = 0; j < unit->integer_inputs.n; j++) m->discrete[j] = (int)lround(m->p[wires[j].signal].a[0]);
  if (unit->integer_inputs.n &&
      check(m, unit, "fmi2SetInteger",
            unit->set_integer(unit->component, unit->integer_inputs.refs, unit->integer_inputs.n, m->discrete)))
    return -1;
  wires += unit->integer_inputs.n;
  for (size_t j = 0; j < unit->boolean_inputs.n; j++) m->discrete[j] = m->p[wires[j].signal].a[0] >= 0.5;
  if (unit->boolean_inputs.n &&
      check(m, unit, "fmi2SetBoolean",
            unit->set_boolean(unit->component, unit->boolean_inputs.refs, unit->boolean_inputs.n, m->discrete)))
    return -1;
  return 0;
}

static int get_values(Master *m, const Unit *unit, const Variables *real, const Variables *integer,
                      const Variables *boolean, double *y) {
  if (real->n && check(m, unit, "fmi2GetReal", unit->get_real(unit->component, real->refs, real->n, y))) return -1;
  y += real->n;
  if (integer->n) {
    if (check(m, unit, "fmi2GetInteger", unit->get_integer(unit->component, integer->refs, integer->n, m->discrete)))
      return -1;
    for (size_t j = 0; j < integer->n; j++) y[j] = m->discrete[j];
    y += integer->n;
  }
  if (boolean->n) {
    if (check(m, unit, "fmi2GetBoolean", unit->get_boolean(unit->component, boolean->refs, boolean->n, m->discrete)))
      return -1;
    for (size_t j = 0; j < boolean->n; j++) y[j] = m->discrete[j] != fmi2False;
  }
  return 0;
}

int get_outputs(Master *m, const Unit *unit) {
  return get_values(m, unit, &unit->real_outputs, &unit->integer_outputs, &unit->boolean_outputs,
                    m->y + unit->first_signal);
}

int get_watched(Master *m, const Unit *unit) {
  double *y = m->y + (size_t)unit->first_signal + unit->real_outputs.n + n_discrete(unit);
  return get_values(m, unit, &unit->real_watched, &unit->integer_watched, &unit->boolean_watched, y);
}

static fmi2Status ask_slopes(const Master *m, const Unit *unit) {
  size_t n = unit->real_outputs.n;
  if (!unit->output_derivatives || n == 0) return fmi2OK;
  double *dy = m->dy + unit->first_signal;
  return unit->get_real_output_derivatives(unit->component, unit->real_outputs.refs, n, m->first_order, dy);
}

static int get_slopes(Master *m, const Unit *unit) {
  return check(m, unit, "fmi2GetRealOutputDerivatives", ask_slopes(m, unit));
}

int get_first_slopes(Master *m, const Unit *unit) {
  for (size_t j = 0; j < unit->real_outputs.n; j++) m->dy[(size_t)unit->first_signal + j] = 0;
  fmi2Status status = ask_slopes(m, unit);
  if (status != fmi2Discard) return check(m, unit, "fmi2GetRealOutputDerivatives", status);
  for (size_t j = 0; j < unit->real_outputs.n; j++) m->dy[(size_t)unit->first_signal + j] = 0;
  return 0;
}

static bool may_discard(const Master *m, const Unit *unit) {
  return m->plan.scheme.adaptive && m->stride > 1 && !unit->is_sink;
}

/* from s to s + h of the step that begins at t, without a look at the outputs */
static int step_part(Master *m, size_t i, double t, double s, double h) {
  const Unit *unit = &m->plan.units[i];
  bool keeps_history = rolls_back(m) && !unit->is_sink;
  if (set_real_inputs(m, unit, &m->scratch[i], s, h) || set_discrete_inputs(m, unit)) return -1;
  fmi2Status status = unit->do_step(unit->component, t + s, h, keeps_history ? fmi2False : fmi2True);
  if (status == fmi2Discard && may_discard(m, unit)) return DISCARDED;
  if (status != fmi2OK && status != fmi2Warning)
    return fail(m, "%s: fmi2DoStep returned %s at t = %.9g s, step %.9g s", unit->name, word(status), t + s, h);
  m->count.warnings += status == fmi2Warning;
  return 0;
}

/* A unit that holds its inputs goes up stairs of them. The last is short, so that outputs which feed inputs through belong to
 * the step's end: FMI 2.0 lets no master set inputs and read outputs without a step in between. */
static int climb(Master *m, size_t i, double t, double s, double h) {
  double run = (h - LAST_STAIR * h) / m->plan.units[i].stairs;
  for (int k = 0; k < m->plan.units[i].stairs; k++) {
    int status = step_part(m, i, t, s + k * run, run);
    if (status) return status;
  }
  double climbed = m->plan.units[i].stairs * run;
  return step_part(m, i, t, s + climbed, h - climbed);
}

/* An input over a step as its unit saw it; stairs count as what they climb. */
static Polynomial seen(const Master *m, const Unit *unit, const Wire *wire, double h) {
  Polynomial p = through(m, wire, 0);
  if (unit->input_order == 1) return line(p.a[0], value(&p, h), h);
  if (unit->input_order == 0 && !unit->stairs) return constant(value(&p, unit->holds_end ? h : 0.5 * h));
  return p;
}

/* Work through ports whose units do not tell it: input times output over the step just computed */
static void measure_work(Master *m, size_t i, double h) {
  for (size_t k = 0; k < m->plan.n_ports; k++) {
    const Port *port = &m->plan.ports[k];
    if (port->unit != (int32_t)i) continue;
    const Unit *unit = &m->plan.units[i];
    Polynomial u = seen(m, unit, &unit->wires[port->input], h);
    Polynomial y = interpolated(m, unit, (size_t)port->output, h);
    m->work[k] = integral(&u, &y, h);
  }
}

int step_unit(Master *m, size_t i, double t, double s, double h) {
  const Unit *unit = &m->plan.units[i];
  int status = unit->stairs ? climb(m, i, t, s, h) : step_part(m, i, t, s, h);
  if (status) return status;
  if (get_outputs(m, unit) || get_slopes(m, unit)) return -1;
  measure_work(m, i, h);
  return 0;
}

int save_states(Master *m) {
  for (size_t i = 0; i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    if (unit->is_sink) continue;
    if (check(m, unit, "fmi2GetFMUstate", unit->get_state(unit->component, &m->scratch[i].state))) return -1;
  }
  return 0;
}

int restore_states(Master *m) {
  for (size_t i = 0; i < m->plan.n_units; i++) {
    const Unit *unit = &m->plan.units[i];
    if (unit->is_sink) continue;
    if (check(m, unit, "fmi2SetFMUstate", unit->set_state(unit->component, m->scratch[i].state))) return -1;
  }
  return 0;
}
