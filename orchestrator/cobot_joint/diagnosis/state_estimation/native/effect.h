/* What a unit of a parameter adds to states and readings along a run; effect.py mirrors it. */
#ifndef EFFECT_H
#define EFFECT_H

#include <stdint.h>

#include "../../../cosim/master/cosim.h"

typedef struct {
  PointFunction *function; /* of the parameter's unit; its directions: the parameter, or one for each column */
  const double *jacobian;  /* [n][n_columns][unknown] at the samples; NULL: the unit gives directional derivatives */
  Variables varied;        /* what differs from column to column, and how: [n_columns][varied.n] */
  const double *values;
  size_t n, n_columns, n_known, n_inner, n_outer, n_x, n_o, n_y;
  size_t points;                /* of each step, where it is looked at; 0: at its ends */
  const int32_t *inner, *outer; /* rows of its unknowns among the followed states and the outputs that are read */
  const double *time, *known;   /* [n], [n][n_known] */
  const double *Phi, *Hold;     /* [n - 1][n_x][n_x] of a part of a step; without points, Hold of a step */
  const double *T, *S;          /* [n - 1][n_x][n_o], [n][n_y][n_o] */
  double *psi, *direct;         /* [n - 1][n_x][n_columns], [n][n_y][n_columns]: filled */
} Effect;

/* 0; -1: the function says why; -2: out of memory */
COSIM_API int effect_along(const Effect *e);

#endif
