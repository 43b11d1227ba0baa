/* A unit that costs nothing, so that what is measured is the master. */
enum { U, Y, REALS };

#include "minimal.h"

static bool start(unit *m) {
  m->real[Y] = 0.0;
  return true;
}

static void advance(unit *m) { m->real[Y] = 1.0 + 0.5 * m->real[U]; }
