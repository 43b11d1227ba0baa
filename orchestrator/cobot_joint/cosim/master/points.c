/* A unit as a function, at many points: states, inputs, parameters and time in, derivatives of states and outputs out.
 *
 * That is what a unit is in initialization mode (FMI 2.0.4, 2.1.6 and 4.2.4): its states have start values that may be set, and all
 * that follows from them may be read. Every point begins with a reset, since only then may its time be set. */
#include <stdio.h>

#include "cosim.h"

#define TRY(call, name)                                                                                                \
  do {                                                                                                                 \
    fmi2Status status = (call);                                                                                        \
    if (status != fmi2OK && status != fmi2Warning) {                                                                   \
      snprintf(f->message, sizeof f->message, "%s returned %d at t = %.9g s", name, status, t);                        \
      return -1;                                                                                                       \
    }                                                                                                                  \
  } while (0)

static int set_point(PointFunction *f, double t, const double *known) {
  TRY(f->reset(f->component), "fmi2Reset");
  if (f->reals.n) TRY(f->set_real(f->component, f->reals.refs, f->reals.n, f->real_values), "fmi2SetReal");
  if (f->integers.n)
    TRY(f->set_integer(f->component, f->integers.refs, f->integers.n, f->integer_values), "fmi2SetInteger");
  if (f->booleans.n)
    TRY(f->set_boolean(f->component, f->booleans.refs, f->booleans.n, f->boolean_values), "fmi2SetBoolean");
  TRY(f->setup_experiment(f->component, fmi2False, 0, t, fmi2False, 0), "fmi2SetupExperiment");
  TRY(f->enter_initialization_mode(f->component), "fmi2EnterInitializationMode");
  if (f->known.n) TRY(f->set_real(f->component, f->known.refs, f->known.n, known), "fmi2SetReal");
  return 0;
}

int cosim_points(PointFunction *f, size_t n_points, const double *time, const double *known, double *unknown,
                 double *jacobian) {
  const double one = 1;
  for (size_t k = 0; k < n_points; k++) {
    const double t = time[k];
    if (set_point(f, t, known + k * f->known.n)) return -1;
    double *z = unknown + k * f->unknown.n;
    if (f->unknown.n) TRY(f->get_real(f->component, f->unknown.refs, f->unknown.n, z), "fmi2GetReal");
    for (size_t j = 0; jacobian && j < f->directions.n; j++)
      TRY(f->get_directional_derivative(f->component, f->unknown.refs, f->unknown.n, f->directions.refs + j, 1, &one,
                                        jacobian + (k * f->directions.n + j) * f->unknown.n),
          "fmi2GetDirectionalDerivative");
  }
  return 0;
}

int cosim_varied(PointFunction *f, double t, const double *known, const Variables *varied, size_t n_columns,
                 const double *values, double *jacobian) {
  const double one = 1;
  if (set_point(f, t, known)) return -1;
  for (size_t j = 0; j < n_columns; j++) {
    if (varied->n) TRY(f->set_real(f->component, varied->refs, varied->n, values + j * varied->n), "fmi2SetReal");
    const fmi2ValueReference *direction = f->directions.refs + (f->directions.n > 1 ? j : 0);
    TRY(f->get_directional_derivative(f->component, f->unknown.refs, f->unknown.n, direction, 1, &one,
                                      jacobian + j * f->unknown.n),
        "fmi2GetDirectionalDerivative");
  }
  return 0;
}
