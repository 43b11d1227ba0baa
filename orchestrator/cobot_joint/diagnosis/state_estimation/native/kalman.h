/* n samples of N deviations and m channels, rows first; kalman.py mirrors it. All calls return 0, or -1: out of memory. */
#ifndef KALMAN_H
#define KALMAN_H

#include <stddef.h>

#if defined _WIN32
#define KALMAN_API __declspec(dllexport)
#else
#define KALMAN_API __attribute__((visibility("default")))
#endif

typedef struct { /* the last N - n_x deviations fade by themselves */
  size_t n, m, N, n_x;
  const double *F, *fade, *jump, *H,
      *r; /* [n][n_x][N], [N - n_x], [n][N], [n][m][N], [n][m]; r: NaN where not recorded */
} KalmanSteps;

typedef struct { /* of channels one after the other; precision: 1/variance of an innovation, 0 where not recorded */
  double *predicted, *updated, *P; /* [n][N], [n][N], [n][N][N]; NULL where not asked for */
  double *e, *precision, *K;       /* [n][m], [n][m], [n][m][N] */
  double log_likelihood;
} KalmanFiltered;

/* Q: [N], R: [m]; z: [N] and P: [N][N] are moved on. begins: z and P belong to the first sample, nothing moves before it */
KALMAN_API int kalman_forward(const KalmanSteps *steps, const double *Q, const double *R, int begins, double *z,
                              double *P, KalmanFiltered *out);
/* all [n][N]; smoothed and variance: both NULL where not asked for, else `in` has P */
KALMAN_API int kalman_backward(const KalmanSteps *steps, const KalmanFiltered *in, double *a, double *M,
                               double *smoothed, double *variance);
/* psi: [n - 1][n_psi][p], added to the first n_psi deviations from sample to sample; direct: [n][m][p];
 * innovations: [n][m] rows of p, each `width` behind the one before */
KALMAN_API int kalman_respond(const KalmanSteps *steps, const KalmanFiltered *in, size_t p, size_t n_psi,
                              const double *psi, const double *direct, size_t width, double *innovations);

#endif
