/* Products of small matrices, rows first, by their rows: the zeros of the left one cost nothing. */
#ifndef ROWS_H
#define ROWS_H

#include <stddef.h>

/* The same operations in the same order, more of them at once where the processor can: the bits do not change. */
#if defined __x86_64__ && defined __GLIBC__ && defined __GNUC__ && !defined __clang__
#define WIDE __attribute__((target_clones("avx2", "default")))
#else
#define WIDE
#endif
/* into every clone: on its own a function would be the processor's least */
#if defined __GNUC__
#define INNER static inline __attribute__((always_inline))
#else
#define INNER static inline
#endif

/* out += sum over k of a[k step] B[k], rows of n; four rows in one pass, since a pass loads and stores all of out */
INNER void add_rows(size_t count, const double *a, size_t step, const double *B, size_t n, double *out) {
  const double *row[4];
  double factor[4];
  size_t waiting = 0;
  for (size_t k = 0; k < count; k++) {
    if (a[k * step] == 0) continue;
    row[waiting] = B + k * n;
    factor[waiting++] = a[k * step];
    if (waiting < 4) continue;
    for (size_t j = 0; j < n; j++)
      out[j] += (factor[0] * row[0][j] + factor[1] * row[1][j]) + (factor[2] * row[2][j] + factor[3] * row[3][j]);
    waiting = 0;
  }
  for (size_t k = 0; k < waiting; k++)
    for (size_t j = 0; j < n; j++) out[j] += factor[k] * row[k][j];
}

/* C = A B; A: [rows][inner], B: [inner][n] */
INNER void multiply(size_t rows, size_t inner, size_t n, const double *A, const double *B, double *C) {
  for (size_t i = 0; i < rows; i++) {
    for (size_t j = 0; j < n; j++) C[i * n + j] = 0;
    add_rows(inner, A + i * inner, 1, B, n, C + i * n);
  }
}

/* four sums side by side: additions need not wait for one another */
INNER double dot(size_t n, const double *a, const double *b) {
  double sum[4] = {0, 0, 0, 0};
  size_t i = 0;
  for (; i + 4 <= n; i += 4)
    for (size_t j = 0; j < 4; j++) sum[j] += a[i + j] * b[i + j];
  for (; i < n; i++) sum[0] += a[i] * b[i];
  return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

#endif
