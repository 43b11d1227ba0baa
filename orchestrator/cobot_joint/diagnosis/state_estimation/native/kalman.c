/* Kalman filter, smoother and the filter's answer to known signals; kalman.py says what the arrays are.
 *
 * The channels' noises are independent, so that a sample's channels are taken one after the other: no matrix is inverted.
 * What is symmetric is written so bit by bit, since what rounding left of the other part would grow. */
#include "kalman.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "rows.h"

/* An innovation of more sigmas counts as one of so many, its variance as larger (Huber's function: Masreliez and Martin
 * 1977, IEEE Trans. Automatic Control 22(3)): impacts are linear only until they happen. */
#define FAR 6.0

/* what a loop over the lower triangle left, above it as well */
INNER void mirror(size_t n, size_t N, double *A) {
  for (size_t i = 0; i < n; i++)
    for (size_t j = 0; j < i; j++) A[j * N + i] = A[i * N + j];
}

/* z = F (z + jump), P = F P F' + Q with F = [F_x; 0 diag(fade)]; work: N (n_x + 1) */
INNER void predict(const KalmanSteps *s, size_t k, const double *Q, double *z, double *P, double *work) {
  const size_t N = s->N, n_x = s->n_x;
  const double *F = s->F + k * n_x * N, *jump = s->jump + k * N;
  double *FP = work, *moved = work + n_x * N;
  for (size_t i = 0; i < N; i++) z[i] += jump[i];
  for (size_t i = 0; i < n_x; i++) moved[i] = dot(N, F + i * N, z);
  memcpy(z, moved, n_x * sizeof *z);
  for (size_t i = n_x; i < N; i++) z[i] *= s->fade[i - n_x];
  multiply(n_x, N, N, F, P, FP);
  for (size_t i = 0; i < n_x; i++)
    for (size_t j = 0; j <= i; j++) P[i * N + j] = dot(N, FP + i * N, F + j * N);
  mirror(n_x, N, P);
  for (size_t i = n_x; i < N; i++) {
    const double fade = s->fade[i - n_x];
    for (size_t j = 0; j < n_x; j++) P[j * N + i] = P[i * N + j] = FP[j * N + i] * fade;
    for (size_t j = n_x; j < N; j++) P[i * N + j] *= fade * s->fade[j - n_x];
  }
  for (size_t i = 0; i < N; i++) P[i * N + i] += Q[i];
}

/* one channel: e, 1/s and K, z and P given it; w: N. Returns -(log s + e^2/s)/2 */
INNER double update(size_t N, const double *h, double r, double R, double *z, double *P, double *out_e,
                    double *out_precision, double *K, double *w) {
  memset(w, 0, N * sizeof *w);
  add_rows(N, h, 1, P, N, w); /* P h */
  const double e = r - dot(N, h, z), s = fmax(dot(N, h, w) + R, e * e / (FAR * FAR)), root = 1 / sqrt(s);
  *out_e = e;
  *out_precision = 1 / s;
  for (size_t i = 0; i < N; i++) {
    K[i] = w[i] / s;
    z[i] += K[i] * e;
    w[i] *= root;
  }
  for (size_t i = 0; i < N; i++)
    for (size_t j = 0; j < N; j++) P[i * N + j] -= w[i] * w[j];
  return -0.5 * (log(s) + e * e / s);
}

WIDE int kalman_forward(const KalmanSteps *steps, const double *Q, const double *R, int begins, double *z, double *P,
                        KalmanFiltered *out) {
  const size_t n = steps->n, m = steps->m, N = steps->N;
  double *work = malloc((N * (steps->n_x + 2) + 1) * sizeof *work);
  if (!work) return -1;
  out->log_likelihood = 0;
  for (size_t k = 0; k < n; k++) {
    if (k > 0 || !begins) predict(steps, k, Q, z, P, work);
    if (out->predicted) memcpy(out->predicted + k * N, z, N * sizeof *z);
    if (out->P) memcpy(out->P + k * N * N, P, N * N * sizeof *P);
    for (size_t j = 0; j < m; j++) {
      const size_t at = k * m + j;
      if (isnan(steps->r[at])) {
        out->e[at] = out->precision[at] = 0;
        memset(out->K + at * N, 0, N * sizeof *z);
      } else {
        out->log_likelihood += update(N, steps->H + at * N, steps->r[at], R[j], z, P, out->e + at, out->precision + at,
                                      out->K + at * N, work);
      }
    }
    if (out->updated) memcpy(out->updated + k * N, z, N * sizeof *z);
  }
  free(work);
  return 0;
}

/* a = h e/s + (I - K h')' a,  M = h h'/s + (I - K h')' M (I - K h') for one channel: with g = M K - h (1/s + K' M K)/2,
 * M -= h g' + g h' */
INNER void take_in(size_t N, const double *h, const double *K, double e, double precision, double *a, double *M,
                   double *g) {
  memset(g, 0, N * sizeof *g);
  add_rows(N, K, 1, M, N, g);
  const double pull = e * precision - dot(N, K, a), half = 0.5 * (precision + dot(N, K, g));
  for (size_t i = 0; i < N; i++) a[i] += h[i] * pull;
  for (size_t i = 0; i < N; i++) g[i] -= half * h[i];
  for (size_t i = 0; i < N; i++) {
    if (h[i] == 0) continue;
    for (size_t j = 0; j < N; j++) M[i * N + j] -= h[i] * g[j];
    for (size_t j = 0; j < N; j++) M[j * N + i] -= h[i] * g[j];
  }
}

/* a = F' a, M = F' M F; with M F = [U; V]: F' M F = F_x' U_x + what fades. work: N (N + n_x) */
INNER void pull_back(const KalmanSteps *s, size_t k, double *a, double *M, double *work) {
  const size_t N = s->N, n_x = s->n_x;
  const double *F = s->F + k * n_x * N;
  double *U = work, *V = work + n_x * N, *sum = V + (N - n_x) * N;
  memset(sum, 0, N * sizeof *sum);
  add_rows(n_x, a, 1, F, N, sum);
  for (size_t i = n_x; i < N; i++) sum[i] += s->fade[i - n_x] * a[i];
  memcpy(a, sum, N * sizeof *a);
  memset(work, 0, N * N * sizeof *work);
  for (size_t i = 0; i < N; i++) add_rows(n_x, M + i * N, 1, F, N, U + i * N); /* of all rows, V too */
  memset(M, 0, n_x * N * sizeof *M);
  for (size_t i = n_x; i < N; i++) {
    memset(M + i * N, 0, n_x * sizeof *M);
    for (size_t j = n_x; j < N; j++) M[i * N + j] *= s->fade[i - n_x] * s->fade[j - n_x];
  }
  for (size_t i = 0; i < N; i++) add_rows(n_x, F + i, N, U, N, M + i * N);
  mirror(N, N, M);
  for (size_t i = n_x; i < N; i++) {
    const double fade = s->fade[i - n_x];
    for (size_t j = 0; j < N; j++) M[i * N + j] += fade * V[(i - n_x) * N + j];
    for (size_t j = 0; j < N; j++) M[j * N + i] += fade * V[(i - n_x) * N + j];
  }
}

WIDE int kalman_backward(const KalmanSteps *steps, const KalmanFiltered *in, double *a_out, double *M_out,
                         double *smoothed, double *variance) {
  const size_t n = steps->n, m = steps->m, N = steps->N;
  double *work = calloc(2 * N * N + 3 * N + 1, sizeof *work);
  if (!work) return -1;
  double *M = work, *room = work + N * N, *a = room + N * N + N, *g = a + N;
  for (size_t k = n; k-- > 0;) {
    for (size_t j = m; j-- > 0;) {
      const size_t at = k * m + j;
      if (in->precision[at] > 0) take_in(N, steps->H + at * N, in->K + at * N, in->e[at], in->precision[at], a, M, g);
    }
    if (smoothed) { /* z = z_predicted + P a, cov z = P - P M P */
      const double *P = in->P + k * N * N;
      multiply(N, N, N, P, M, room);
      for (size_t i = 0; i < N; i++) {
        smoothed[k * N + i] = in->predicted[k * N + i] + dot(N, P + i * N, a);
        variance[k * N + i] = fmax(0, P[i * N + i] - dot(N, room + i * N, P + i * N));
      }
    }
    for (size_t i = 0; i < N; i++) {
      a_out[k * N + i] = a[i];
      M_out[k * N + i] = M[i * N + i];
    }
    if (k > 0) pull_back(steps, k, a, M, room);
  }
  free(work);
  return 0;
}

WIDE int kalman_respond(const KalmanSteps *steps, const KalmanFiltered *in, size_t p, size_t n_psi, const double *psi,
                        const double *direct, size_t width, double *innovations) {
  const size_t n = steps->n, m = steps->m, N = steps->N, n_x = steps->n_x;
  double *x = calloc((N + n_x) * p + 1, sizeof *x);
  if (!x) return -1;
  double *moved = x + N * p;
  for (size_t k = 0; k < n; k++) {
    if (k > 0) {
      multiply(n_x, N, p, steps->F + k * n_x * N, x, moved);
      memcpy(x, moved, n_x * p * sizeof *x);
      for (size_t i = n_x; i < N; i++)
        for (size_t c = 0; c < p; c++) x[i * p + c] *= steps->fade[i - n_x];
      for (size_t i = 0; i < n_psi * p; i++) x[i] += psi[(k - 1) * n_psi * p + i];
    }
    for (size_t j = 0; j < m; j++) {
      const size_t at = k * m + j;
      double *e = innovations + at * width;
      if (!(in->precision[at] > 0)) {
        memset(e, 0, p * sizeof *e);
        continue;
      }
      const double *K = in->K + at * N, scale = sqrt(in->precision[at]);
      memcpy(e, direct + at * p, p * sizeof *e);
      add_rows(N, steps->H + at * N, 1, x, p, e);
      for (size_t i = 0; i < N; i++)
        if (K[i] != 0)
          for (size_t c = 0; c < p; c++) x[i * p + c] -= K[i] * e[c];
      for (size_t c = 0; c < p; c++) e[c] *= scale;
    }
  }
  free(x);
  return 0;
}
