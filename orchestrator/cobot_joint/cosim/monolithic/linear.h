/* Small sparse linear systems: dense storage, and a mask of 64 bits per row that says where it may differ from zero. */
#ifndef COSIM_LINEAR_H
#define COSIM_LINEAR_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { MOST_STATES = 64 };

#if defined _MSC_VER
#include <intrin.h>
static inline size_t lowest_bit(uint64_t mask) {
  unsigned long k;
  _BitScanForward64(&k, mask);
  return k;
}
#else
static inline size_t lowest_bit(uint64_t mask) { return (size_t)__builtin_ctzll(mask); }
#endif

static inline uint64_t bit(size_t k) { return UINT64_C(1) << k; }
static inline uint64_t below(size_t k) { return bit(k) - 1; }
static inline uint64_t above(size_t k) { return ~(below(k) | bit(k)); }
/* for every set bit: `for (EACH(k, mask)) { const size_t j = lowest_bit(k); .. }` */
#define EACH(k, mask)                                                                                                  \
  uint64_t k = (mask);                                                                                                 \
  k;                                                                                                                   \
  k &= k - 1

typedef struct {
  size_t n;
  uint64_t row[MOST_STATES], column[MOST_STATES]; /* of the factors, what elimination fills in among them */
  double a[MOST_STATES][MOST_STATES];
} Factors;

/* Where the factors of a matrix with these rows may differ from zero. */
static inline void fill_in(Factors *f, size_t n, const uint64_t row[]) {
  f->n = n;
  for (size_t i = 0; i < n; i++) f->row[i] = row[i] | bit(i);
  for (size_t k = 0; k < n; k++)
    for (size_t i = k + 1; i < n; i++)
      if (f->row[i] & bit(k)) f->row[i] |= f->row[k] & above(k);
  for (size_t j = 0; j < n; j++) {
    f->column[j] = 0;
    for (size_t i = 0; i < n; i++) f->column[j] |= f->row[i] & bit(j) ? bit(i) : 0;
  }
}

/* LU of d I - J, without pivoting: the diagonal dominates once d is large. false: it does not yet. */
static inline bool factorize(Factors *f, double d, double (*J)[MOST_STATES]) {
  for (size_t i = 0; i < f->n; i++) {
    for (EACH(k, f->row[i])) f->a[i][lowest_bit(k)] = -J[i][lowest_bit(k)];
    f->a[i][i] += d;
  }
  for (size_t k = 0; k < f->n; k++) {
    const double pivot = f->a[k][k];
    if (!(fabs(pivot) > 1e-9 * d) || !isfinite(pivot)) return false;
    for (EACH(below_k, f->column[k] & above(k))) {
      double *row = f->a[lowest_bit(below_k)];
      const double l = row[k] /= pivot;
      if (l == 0) continue;
      for (EACH(right, f->row[k] & above(k))) row[lowest_bit(right)] -= l * f->a[k][lowest_bit(right)];
    }
  }
  return true;
}

static inline void solve(const Factors *f, double b[]) {
  for (size_t i = 0; i < f->n; i++)
    for (EACH(left, f->row[i] & below(i))) b[i] -= f->a[i][lowest_bit(left)] * b[lowest_bit(left)];
  for (size_t i = f->n; i-- > 0;) {
    for (EACH(right, f->row[i] & above(i))) b[i] -= f->a[i][lowest_bit(right)] * b[lowest_bit(right)];
    b[i] /= f->a[i][i];
  }
}

#endif
