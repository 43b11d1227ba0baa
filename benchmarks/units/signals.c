/* The bench's inputs as a unit, for masters that cannot play a table: linear between the rows of resources/signals.bin.
 * Its outputs hold over the next communication step, so they are taken `ahead` of now: at the middle of that step. */
#include <stdio.h>

enum { V_COMMAND, I_BRAKE, TAU_HOLD, REALS };

#include "minimal.h"

typedef struct {
  double rows, interval, ahead;
  double row[][REALS];
} table;

static bool start(unit *m) {
  if (m->data) return true;
  char path[4096];
  if (!m->resources || snprintf(path, sizeof path, "%s/signals.bin", m->resources) >= (int)sizeof path) return false;
  FILE *file = fopen(path, "rb");
  if (!file) return false;
  long size = -1;
  if (fseek(file, 0, SEEK_END) == 0) size = ftell(file);
  rewind(file);
  table *t = size > (long)sizeof *t ? malloc((size_t)size) : NULL;
  const bool complete = t && fread(t, 1, (size_t)size, file) == (size_t)size;
  fclose(file);
  m->data = t;
  return complete;
}

static void advance(unit *m) {
  const table *t = m->data;
  const double place = (m->time + t->ahead) / t->interval;
  const double last = t->rows - 1.0;
  const size_t row = place <= 0.0 ? 0 : place >= last ? (size_t)last - 1 : (size_t)place;
  const double s = place <= 0.0 ? 0.0 : place >= last ? 1.0 : place - (double)row;

  for (int n = 0; n < REALS; n++) m->real[n] = t->row[row][n] + s * (t->row[row + 1][n] - t->row[row][n]);
}
