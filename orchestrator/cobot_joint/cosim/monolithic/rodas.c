/* RODAS, a Rosenbrock method of order 4(3), L-stable and stiffly accurate, with an interpolant of order 3
 * (Hairer and Wanner 1996, "Solving Ordinary Differential Equations II", section IV.7, and their code of that name):
 *
 *   (I/(gamma h) - J) k_i = f(t + alpha_i h, x + sum_j a_ij k_j) + sum_j c_ij/h k_j + h d_i df/dt
 */
#include <math.h>

#include "monolithic/stepper.h"

enum { STAGES = 6 };
static const double GAMMA = 0.25;
static const double ALPHA[STAGES] = {0, 0.386, 0.21, 0.63, 1, 1};
static const double D[STAGES] = {0.25, -0.1043, 0.1035, -0.0362, 0, 0};
static const double A[STAGES][STAGES] = {
    {0},
    {1.544},
    {0.9466785280815826, 0.2557011698983284},
    {3.314825187068521, 2.896124015972201, 0.9986419139977817},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950},
    {1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1}};
static const double C[STAGES][STAGES] = {
    {0},
    {-5.6688},
    {-2.430093356833875, -0.2063599157091915},
    {-0.1073529058151375, -9.594562251023355, -20.47028614809616},
    {7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160},
    {8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054}};
static const double H2[STAGES] = {10.12623508344586,  -7.487995877610167, -34.80091861555747,
                                  -7.992771707568823, 1.025137723295662,  0};
static const double H3[STAGES] = {-0.6762803392801253, 6.087714651680015,  16.43084320892478,
                                  24.76722511418386,   -6.594389125716872, 0};

/* x + sum_j a_ij k_j */
static void stage_point(const Stepper *r, int i, double x[]) {
  for (size_t n = 0; n < r->system->n; n++) x[n] = r->x[n];
  for (int j = 0; j < i; j++)
    for (size_t n = 0; n < r->system->n; n++) x[n] += A[i][j] * r->k[j][n];
}

double rodas_step(Stepper *r, double h, double tolerance) {
  FieldSystem *s = r->system;
  double x[MOST_STATES];
  r->h = h;
  if (!r->linear) {
    stay(r);
    system_jacobian(s, r->t, r->x, r->f, r->J, r->f_t);
    r->linear = true;
    if (s->rows_grew) fill_in(&r->factors, s->n, s->rows);
    s->rows_grew = false;
  }
  r->there = false;
  if (!factorize(&r->factors, 1 / (GAMMA * h), r->J)) return INFINITY;
  for (int i = 0; i < STAGES; i++) {
    double *k = r->k[i];
    stage_point(r, i, x);
    if (i > 0) system_evaluate(s, r->t + ALPHA[i] * h, x, k);
    for (size_t n = 0; n < s->n; n++) k[n] = (i > 0 ? k[n] : r->f[n]) + h * D[i] * r->f_t[n];
    for (int j = 0; j < i; j++)
      for (size_t n = 0; n < s->n; n++) k[n] += C[i][j] / h * r->k[j][n];
    solve(&r->factors, k);
  }
  const double *last = r->k[STAGES - 1];
  for (size_t n = 0; n < s->n; n++) {
    r->y[n] = x[n] + last[n];
    r->c2[n] = r->c3[n] = r->c4[n] = 0;
    for (int j = 0; j < STAGES - 1; j++) {
      r->c2[n] += H2[j] * r->k[j][n];
      r->c3[n] += H3[j] * r->k[j][n];
    }
  }
  return norm(s, last, tolerance);
}
