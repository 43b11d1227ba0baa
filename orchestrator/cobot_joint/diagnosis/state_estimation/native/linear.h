/* Jacobians of a system along a run, and its tangent from sample to sample; linearisation.py mirrors it.
 *
 * Columns are in the order x (followed states), d (ports), p (parameters): n_q in all; behind them u (wires), n_u. */
#ifndef LINEAR_H
#define LINEAR_H

#include <stdint.h>

#include "../../../cosim/master/cosim.h"

typedef struct { /* a unit; its unknowns are derivatives of states, then outputs */
  PointFunction *function;
  const double *jacobian; /* [n][directions][unknown]; NULL: the unit gives directional derivatives itself */
  size_t n_directions, n_inner, n_outer;
  size_t first_known;           /* where its own begin in a row of `known` */
  const int32_t *inner, *outer; /* rows of its unknowns among the followed states and the outputs that are read */
  const int32_t *column;        /* of its directions among x, d, p, u */
  const double *factor;         /* of its directions */
} LinearPart;

typedef struct {
  size_t n_parts;
  const LinearPart *parts;
  size_t n_x, n_q, n_u, n_o, n_y, n_known; /* n_o: outputs of units that are read, n_y: channels */
  const double *wires, *taps;              /* [n_u][n_o], [n_y][n_o]: what a wire and a channel carry of which output */
  int32_t failed;                          /* the part whose function says why, or: */
} LinearSystem;
enum { NO_MEMORY = -1, LOOP = -2 }; /* LOOP: of wires, without an answer */

/* time: [n], known: [n][n_known]. X: [n][n_x][n_q], Y: [n][n_y][n_q], T: [n][n_x][n_o], S: [n][n_y][n_o], all filled.
 * 0, or -1: `failed` says why. */
COSIM_API int linear_jacobians(LinearSystem *s, size_t n, const double *time, const double *known, double *X, double *Y,
                               double *T, double *S);

typedef struct { /* n steps of length h; m states, of which `scale` counts as much, n_q columns */
  size_t n, m, n_q;
  double h;
  const double *scale, *X;         /* [m], [n][m][n_q] */
  double *A, *Phi, *Hold, *inputs; /* [n][m][m] thrice, [n][m][n_q - m]: filled */
} LinearSteps;
/* Over a step the Jacobians X are constant. 0, or -1: out of memory */
COSIM_API int linear_steps(const LinearSteps *s);

/* e^(A h) and its integral from 0 to h; A, E, I: [n][m][m]; scale: [m]. 0, or -1: out of memory */
COSIM_API int linear_exponential(size_t n, size_t m, const double *A, double h, const double *scale, double *E,
                                 double *I);

#endif
