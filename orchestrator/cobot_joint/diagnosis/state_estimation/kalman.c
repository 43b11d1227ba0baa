/* Kalman filter, smoother and the filter's answer to known signals; kalman.py says what the arrays are.
 *
 * The channels' noises are independent, so that a sample's channels are taken one after the other: no matrix is inverted. */
#include "kalman.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* An innovation of more sigmas counts as one of so many, its variance as larger (Huber's function: Masreliez and Martin
 * 1977, IEEE Trans. Automatic Control 22(3)): impacts are linear only until they happen. */
#define FAR 6.0

/* C = A B */
static void product(size_t n, const double *A, const double *B, double *C) {
  memset(C, 0, n * n * sizeof *C);
  for (size_t i = 0; i < n; i++)
    for (size_t k = 0; k < n; k++) {
      const double a = A[i * n + k];
      if (a == 0) continue; /* more than half of a transition */
      for (size_t j = 0; j < n; j++) C[i * n + j] += a * B[k * n + j];
    }
}

static void transpose(size_t n, const double *A, double *C) {
  for (size_t i = 0; i < n; i++)
    for (size_t j = 0; j < n; j++) C[j * n + i] = A[i * n + j];
}

/* P = A P A' of a symmetric P; the zeros of A save twice as A (A P)'. work: 2 n^2 */
static void congruence(size_t n, const double *A, double *P, double *work) {
  double *one = work, *other = work + n * n;
  product(n, A, P, one);
  transpose(n, one, other);
  product(n, A, other, P);
}

/* what a loop over the lower triangle left, above it as well */
static void mirror(size_t n, double *A) {
  for (size_t i = 0; i < n; i++)
    for (size_t j = 0; j < i; j++) A[j * n + i] = A[i * n + j];
}

/* four sums side by side: additions need not wait for one another */
static double dot(size_t n, const double *a, const double *b) {
  double sum[4] = {0, 0, 0, 0};
  size_t i = 0;
  for (; i + 4 <= n; i += 4)
    for (size_t j = 0; j < 4; j++) sum[j] += a[i + j] * b[i + j];
  for (; i < n; i++) sum[0] += a[i] * b[i];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* z = F (z + jump), P = F P F' + Q */
static void predict(size_t N, const double *F, const double *jump, const double *Q, double *z, double *P,
                    double *work) {
  double *moved = work + 2 * N * N;
  for (size_t i = 0; i < N; i++) z[i] += jump[i];
  for (size_t i = 0; i < N; i++) moved[i] = dot(N, F + i * N, z);
  memcpy(z, moved, N * sizeof *z);
  congruence(N, F, P, work);
  for (size_t i = 0; i < N; i++) P[i * N + i] += Q[i];
}

int kalman_forward(const KalmanSteps *steps, const double *Q, const double *R, int begins, double *z, double *P,
                   KalmanFiltered *out) {
  const size_t n = steps->n, m = steps->m, N = steps->N;
  double *work = malloc((2 * N * N + 2 * N + 1) * sizeof *work), *Ph = work ? work + 2 * N * N + N : NULL;
  if (!work) return -1;
  out->log_likelihood = 0;
  for (size_t k = 0; k < n; k++) {
    if (k > 0 || !begins) predict(N, steps->F + k * N * N, steps->jump + k * N, Q, z, P, work);
    memcpy(out->predicted + k * N, z, N * sizeof *z);
    memcpy(out->P + k * N * N, P, N * N * sizeof *P);
    for (size_t j = 0; j < m; j++) {
      const size_t at = k * m + j;
      const double *h = steps->H + at * N, r = steps->r[at];
      double *K = out->K + at * N;
      if (isnan(r)) {
        out->e[at] = out->precision[at] = 0;
        memset(K, 0, N * sizeof *K);
        continue;
      }
      for (size_t i = 0; i < N; i++) Ph[i] = dot(N, P + i * N, h);
      const double e = r - dot(N, h, z), s = fmax(dot(N, h, Ph) + R[j], e * e / (FAR * FAR));
      out->e[at] = e;
      out->precision[at] = 1 / s;
      out->log_likelihood -= 0.5 * (log(s) + e * e / s);
      for (size_t i = 0; i < N; i++) {
        K[i] = Ph[i] / s;
        z[i] += K[i] * e;
      }
      for (size_t i = 0; i < N; i++)
        for (size_t l = 0; l <= i; l++) P[i * N + l] -= K[i] * Ph[l];
      mirror(N, P);
    }
    memcpy(out->updated + k * N, z, N * sizeof *z);
  }
  free(work);
  return 0;
}

/* a = h e/s + (I - K h')' a,  M = h h'/s + (I - K h')' M (I - K h') for one channel; M is written symmetric, since what
 * rounding left of the other part would grow */
static void take_in(size_t N, const double *h, const double *K, double e, double precision, double *a, double *M,
                    double *MK) {
  for (size_t i = 0; i < N; i++) MK[i] = dot(N, M + i * N, K);
  const double pull = e * precision - dot(N, K, a), weight = precision + dot(N, K, MK);
  for (size_t i = 0; i < N; i++) a[i] += h[i] * pull;
  for (size_t i = 0; i < N; i++)
    for (size_t l = 0; l <= i; l++) M[i * N + l] += weight * h[i] * h[l] - h[i] * MK[l] - MK[i] * h[l];
  mirror(N, M);
}

int kalman_backward(const KalmanSteps *steps, const KalmanFiltered *in, double *a_out, double *M_out, double *smoothed,
                    double *variance) {
  const size_t n = steps->n, m = steps->m, N = steps->N;
  double *work = calloc(4 * N * N + 2 * N + 1, sizeof *work);
  if (!work) return -1;
  double *M = work, *F_transposed = work + N * N, *room = work + 2 * N * N, *a = work + 4 * N * N, *MK = a + N;
  for (size_t k = n; k-- > 0;) {
    const double *P = in->P + k * N * N, *F = steps->F + k * N * N;
    for (size_t j = m; j-- > 0;) {
      const size_t at = k * m + j;
      if (in->precision[at] > 0) take_in(N, steps->H + at * N, in->K + at * N, in->e[at], in->precision[at], a, M, MK);
    }
    if (smoothed) { /* z = z_predicted + P a, cov z = P - P M P */
      product(N, P, M, room);
      for (size_t i = 0; i < N; i++) {
        smoothed[k * N + i] = in->predicted[k * N + i] + dot(N, P + i * N, a);
        variance[k * N + i] = fmax(0, P[i * N + i] - dot(N, room + i * N, P + i * N));
      }
    }
    for (size_t i = 0; i < N; i++) {
      a_out[k * N + i] = a[i];
      M_out[k * N + i] = M[i * N + i];
    }
    transpose(N, F, F_transposed);
    for (size_t i = 0; i < N; i++) MK[i] = dot(N, F_transposed + i * N, a);
    memcpy(a, MK, N * sizeof *a);
    congruence(N, F_transposed, M, room);
  }
  free(work);
  return 0;
}

int kalman_respond(const KalmanSteps *steps, const KalmanFiltered *in, size_t p, size_t n_x, const double *psi,
                   const double *direct, double *innovations) {
  const size_t n = steps->n, m = steps->m, N = steps->N;
  double *x = calloc(2 * N * p + p + 1, sizeof *x);
  if (!x) return -1;
  double *moved = x + N * p, *e = moved + N * p;
  for (size_t k = 0; k < n; k++) {
    const double *F = steps->F + k * N * N;
    if (k > 0) {
      memset(moved, 0, N * p * sizeof *moved);
      for (size_t i = 0; i < N; i++)
        for (size_t l = 0; l < N; l++) {
          const double f = F[i * N + l];
          if (f == 0) continue;
          for (size_t c = 0; c < p; c++) moved[i * p + c] += f * x[l * p + c];
        }
      memcpy(x, moved, N * p * sizeof *x);
      for (size_t i = 0; i < n_x * p; i++) x[i] += psi[(k - 1) * n_x * p + i];
    }
    for (size_t j = 0; j < m; j++) {
      const size_t at = k * m + j;
      double *out = innovations + at * p;
      memset(out, 0, p * sizeof *out);
      if (!(in->precision[at] > 0)) continue;
      const double *h = steps->H + at * N, *K = in->K + at * N, scale = sqrt(in->precision[at]);
      for (size_t c = 0; c < p; c++) e[c] = direct[at * p + c];
      for (size_t i = 0; i < N; i++)
        if (h[i] != 0)
          for (size_t c = 0; c < p; c++) e[c] += h[i] * x[i * p + c];
      for (size_t i = 0; i < N; i++)
        for (size_t c = 0; c < p; c++) x[i * p + c] -= K[i] * e[c];
      for (size_t c = 0; c < p; c++) out[c] = scale * e[c];
    }
  }
  free(x);
  return 0;
}
