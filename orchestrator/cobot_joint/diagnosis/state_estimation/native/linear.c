/* Jacobians of units joined along the wires, and the tangent from sample to sample; linearisation.py says what they are. */
#include "linear.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "rows.h"

/* Joined along the wires ------------------------------------------------------------------------------------------------------ */

typedef struct {                           /* of one sample */
  double *F, *G;                           /* [n_x] and [n_o] rows of n_q + n_u */
  double *M, *u, *closed, *unknown, *part; /* [n_u][n_u], [n_u][n_o], [n_o][n_o]; of one unit */
} Sample;

static size_t most(size_t a, size_t b) { return a > b ? a : b; }

static double *room_for(const LinearSystem *s, Sample *at) {
  size_t n_unknown = 0, n_part = 0, wide = s->n_q + s->n_u;
  for (size_t k = 0; k < s->n_parts; k++) {
    const LinearPart *part = &s->parts[k];
    n_unknown = most(n_unknown, part->n_inner + part->n_outer);
    n_part = most(n_part, part->n_directions * (part->n_inner + part->n_outer));
  }
  double *room =
      malloc(((s->n_x + s->n_o) * wide + s->n_u * (s->n_u + s->n_o) + s->n_o * s->n_o + n_unknown + n_part + 1) *
             sizeof *room);
  if (!room) return NULL;
  at->F = room;
  at->G = at->F + s->n_x * wide;
  at->M = at->G + s->n_o * wide;
  at->u = at->M + s->n_u * s->n_u;
  at->closed = at->u + s->n_u * s->n_o;
  at->unknown = at->closed + s->n_o * s->n_o;
  at->part = at->unknown + n_unknown;
  return room;
}

/* every unit's derivatives into F and G; -1: a unit refuses */
static int gather(LinearSystem *s, size_t k, double t, const double *known, Sample *at) {
  const size_t wide = s->n_q + s->n_u;
  memset(at->F, 0, (s->n_x + s->n_o) * wide * sizeof *at->F); /* G behind it */
  for (size_t i = 0; i < s->n_parts; i++) {
    const LinearPart *part = &s->parts[i];
    const size_t n_unknown = part->n_inner + part->n_outer;
    const double *J = part->jacobian ? part->jacobian + k * part->n_directions * n_unknown : at->part;
    if (!part->jacobian && cosim_points(part->function, 1, &t, known + part->first_known, at->unknown, at->part)) {
      s->failed = (int32_t)i;
      return -1;
    }
    for (size_t j = 0; j < part->n_directions; j++) {
      const double *column = J + j * n_unknown;
      double *F = at->F + part->column[j], *G = at->G + part->column[j];
      for (size_t r = 0; r < part->n_inner; r++) F[(size_t)part->inner[r] * wide] += part->factor[j] * column[r];
      column += part->n_inner;
      for (size_t r = 0; r < part->n_outer; r++) G[(size_t)part->outer[r] * wide] += part->factor[j] * column[r];
    }
  }
  return 0;
}

/* M X = B by elimination with the largest pivots, in place; M: [n][n], B: [n][p]. -1: there is none */
INNER int solve(size_t n, size_t p, double *M, double *B) {
  for (size_t c = 0; c < n; c++) {
    size_t pivot = c;
    for (size_t i = c + 1; i < n; i++)
      if (fabs(M[i * n + c]) > fabs(M[pivot * n + c])) pivot = i;
    if (M[pivot * n + c] == 0) return -1;
    for (size_t j = 0; pivot != c && j < n; j++) {
      const double kept = M[c * n + j];
      M[c * n + j] = M[pivot * n + j];
      M[pivot * n + j] = kept;
    }
    for (size_t j = 0; pivot != c && j < p; j++) {
      const double kept = B[c * p + j];
      B[c * p + j] = B[pivot * p + j];
      B[pivot * p + j] = kept;
    }
    for (size_t i = c + 1; i < n; i++) {
      if (M[i * n + c] == 0) continue;
      const double f = M[i * n + c] / M[c * n + c];
      for (size_t j = c; j < n; j++) M[i * n + j] -= f * M[c * n + j];
      for (size_t j = 0; j < p; j++) B[i * p + j] -= f * B[c * p + j];
    }
  }
  for (size_t c = n; c-- > 0;) {
    for (size_t i = c + 1; i < n; i++)
      if (M[c * n + i] != 0)
        for (size_t j = 0; j < p; j++) B[c * p + j] -= M[c * n + i] * B[i * p + j];
    for (size_t j = 0; j < p; j++) B[c * p + j] /= M[c * n + c];
  }
  return 0;
}

/* -1: the wires' loop has no answer. With out = G_q q + G_u u and u = wires out: u = (I - wires G_u)^-1 wires G_q q; `closed`: I + G_u (I - wires G_u)^-1 wires */
INNER int join(const LinearSystem *s, Sample *at, double *X, double *Y, double *T, double *S) {
  const size_t n_q = s->n_q, n_u = s->n_u, n_o = s->n_o, wide = n_q + n_u;
  memset(at->M, 0, n_u * n_u * sizeof *at->M);
  for (size_t i = 0; i < n_u; i++) {
    for (size_t r = 0; r < n_o; r++)
      if (s->wires[i * n_o + r] != 0)
        for (size_t j = 0; j < n_u; j++) at->M[i * n_u + j] -= s->wires[i * n_o + r] * at->G[r * wide + n_q + j];
    at->M[i * n_u + i] += 1;
  }
  memcpy(at->u, s->wires, n_u * n_o * sizeof *at->u);
  if (solve(n_u, n_o, at->M, at->u)) return -1;
  memset(at->closed, 0, n_o * n_o * sizeof *at->closed);
  for (size_t r = 0; r < n_o; r++) {
    at->closed[r * n_o + r] = 1;
    add_rows(n_u, at->G + r * wide + n_q, 1, at->u, n_o, at->closed + r * n_o);
  }
  multiply(s->n_y, n_o, n_o, s->taps, at->closed, S);
  for (size_t i = 0; i < s->n_x; i++) {
    memset(T + i * n_o, 0, n_o * sizeof *T);
    add_rows(n_u, at->F + i * wide + n_q, 1, at->u, n_o, T + i * n_o);
    memcpy(X + i * n_q, at->F + i * wide, n_q * sizeof *X);
    for (size_t r = 0; r < n_o; r++)
      if (T[i * n_o + r] != 0)
        for (size_t j = 0; j < n_q; j++) X[i * n_q + j] += T[i * n_o + r] * at->G[r * wide + j];
  }
  memset(Y, 0, s->n_y * n_q * sizeof *Y);
  for (size_t i = 0; i < s->n_y; i++)
    for (size_t r = 0; r < n_o; r++)
      if (S[i * n_o + r] != 0)
        for (size_t j = 0; j < n_q; j++) Y[i * n_q + j] += S[i * n_o + r] * at->G[r * wide + j];
  return 0;
}

WIDE int linear_jacobians(LinearSystem *s, size_t n, const double *time, const double *known, double *X, double *Y,
                          double *T, double *S) {
  Sample at;
  double *room = room_for(s, &at);
  s->failed = room ? LOOP : NO_MEMORY;
  int status = room ? 0 : -1;
  for (size_t k = 0; status == 0 && k < n; k++) {
    status = gather(s, k, time[k], known + k * s->n_known, &at);
    if (status == 0)
      status = join(s, &at, X + k * s->n_x * s->n_q, Y + k * s->n_y * s->n_q, T + k * s->n_x * s->n_o,
                    S + k * s->n_y * s->n_o);
  }
  free(room);
  return status;
}

/* From sample to sample ------------------------------------------------------------------------------------------------------- */

static const double SMALL = 0.25; /* norm below which the exponential's series is summed */
enum { ORDER = 8, WIDEST = 16 };  /* of the series: 1e-11 is left out; of rows in registers */

/* C = A B of m rows; `wide` is a constant where it is called from, so that a row stays in registers */
INNER void row_by_row(size_t m, size_t wide, const double *A, const double *B, double *C) {
  for (size_t i = 0; i < m; i++) {
    double sum[WIDEST] = {0};
    for (size_t k = 0; k < m; k++) {
      const double a = A[i * wide + k];
      if (a == 0) continue;
      for (size_t j = 0; j < wide; j++) sum[j] += a * B[k * wide + j];
    }
    for (size_t j = 0; j < wide; j++) C[i * wide + j] = sum[j];
  }
}

INNER void square_product(size_t m, size_t wide, const double *A, const double *B, double *C) {
  switch (wide) {
    case 4: row_by_row(m, 4, A, B, C); break;
    case 8: row_by_row(m, 8, A, B, C); break;
    case 12: row_by_row(m, 12, A, B, C); break;
    case WIDEST: row_by_row(m, WIDEST, A, B, C); break;
    default: multiply(m, wide, wide, A, B, C); /* what is 0 asks for no row */
  }
}

/* E = I + z p */
INNER void complete(size_t m, size_t wide, const double *z, const double *p, double *E) {
  square_product(m, wide, z, p, E);
  for (size_t i = 0; i < m; i++) E[i * wide + i] += 1;
}

/* Scaling and squaring (Moler and Van Loan 2003, SIAM Review 45(1), method 3), of p alone: with z = A h/2^s,
 * e^z = I + z p(z), p(2z) = p(z) (I + e^z)/2. Rows of `wide`, of which the last are 0; E and I likewise. work: 3 m wide */
INNER void exponential(size_t m, size_t wide, const double *A, double h, const double *scale, double *E, double *I,
                       double *work) {
  double *z = work, *p = z + m * wide, *next = p + m * wide, norm = 0;
  memset(work, 0, 3 * m * wide * sizeof *work);
  for (size_t i = 0; i < m; i++) {
    double sum = 0;
    for (size_t j = 0; j < m; j++) sum += fabs(z[i * wide + j] = A[i * m + j] * h * scale[j] / scale[i]);
    norm = fmax(norm, sum);
  }
  int halvings = norm > SMALL && isfinite(norm) ? (int)ceil(log2(norm / SMALL)) : 0;
  const double part = ldexp(1.0, -halvings);
  for (size_t i = 0; i < m * wide; i++) z[i] *= part;
  for (size_t i = 0; i < m; i++) p[i * wide + i] = 1;
  for (int k = ORDER; k > 1; k--) { /* p = I + z/2 (I + z/3 (I + ...)) */
    square_product(m, wide, z, p, next);
    for (size_t i = 0; i < m * wide; i++) p[i] = next[i] / k;
    for (size_t i = 0; i < m; i++) p[i * wide + i] += 1;
  }
  complete(m, wide, z, p, E);
  for (; halvings > 0; halvings--) {
    square_product(m, wide, p, E, next);
    for (size_t i = 0; i < m * wide; i++) p[i] = (p[i] + next[i]) / 2;
    for (size_t i = 0; i < m * wide; i++) z[i] *= 2;
    complete(m, wide, z, p, E); /* its zeros make this cheaper than e^z e^z */
  }
  for (size_t i = 0; i < m; i++)
    for (size_t j = 0; j < m; j++) {
      E[i * wide + j] *= scale[i] / scale[j];
      I[i * wide + j] = h * p[i * wide + j] * scale[i] / scale[j];
    }
}

INNER size_t padded(size_t m) { return (m + 3) / 4 * 4; } /* whole vectors */

WIDE int linear_exponential(size_t n, size_t m, const double *A, double h, const double *scale, double *E, double *I) {
  const size_t wide = padded(m);
  double *room = malloc((5 * m * wide + 1) * sizeof *room);
  if (!room) return -1;
  double *e = room + 3 * m * wide, *integral = e + m * wide;
  for (size_t k = 0; k < n; k++) {
    exponential(m, wide, A + k * m * m, h, scale, e, integral, room);
    for (size_t i = 0; i < m; i++) {
      memcpy(E + (k * m + i) * m, e + i * wide, m * sizeof *E);
      memcpy(I + (k * m + i) * m, integral + i * wide, m * sizeof *I);
    }
  }
  free(room);
  return 0;
}

WIDE int linear_steps(const LinearSteps *s) {
  const size_t m = s->m, n_q = s->n_q, n_in = n_q - m;
  double *B = malloc((m * n_in + 1) * sizeof *B);
  if (!B) return -1;
  int status = 0;
  for (size_t k = 0; status == 0 && k < s->n; k++) {
    for (size_t i = 0; i < m; i++) {
      const double *X = s->X + (k * m + i) * n_q;
      memcpy(s->A + (k * m + i) * m, X, m * sizeof *X);
      memcpy(B + i * n_in, X + m, n_in * sizeof *X);
    }
    status = linear_exponential(1, m, s->A + k * m * m, s->h, s->scale, s->Phi + k * m * m, s->Hold + k * m * m);
    multiply(m, m, n_in, s->Hold + k * m * m, B, s->inputs + k * m * n_in);
  }
  free(B);
  return status;
}
