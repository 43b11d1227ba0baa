/* y = 2 u, until it takes its process with it: an instance called `segv_in_DoStep` does that there, that way. */
#define _GNU_SOURCE
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static volatile int zero, sink;
static int *volatile nowhere;
static void (*volatile nothing)(void);

static int deep(int n) {
  if (n < 0) return 0;
  volatile char room[4096];
  memset((void *)room, n, sizeof room);
  return deep(n + 1) + room[n % 4096];
}

static void eat(void) {
  for (;;) {
    char *more = malloc(1 << 20);
    if (!more) abort();
    memset(more, 1, 1 << 20);
  }
}

static void end(const char *name, const char *call) {
  const char *there = strstr(name, "_in_");
  if (!there || strcmp(there + 4, call)) return;
#define WAY(way, action)                                                                                               \
  if (!strncmp(name, way "_in_", strlen(way) + 4)) action
  WAY("segv", *nowhere = 1);
  WAY("call", nothing());
  WAY("fpe", sink = 7 / zero);
  WAY("abort", abort());
  WAY("assert", (fprintf(stderr, "unit.c:7: assertion x > 0 failed\n"), abort()));
  WAY("stack", sink = deep(1));
  WAY("exit", exit(0));
  WAY("quit", _exit(3));
  WAY("loop", for (;;) sink++);
  WAY("sleep", for (;;) sleep(1000));
  WAY("stop", raise(SIGSTOP));
  WAY("kill", raise(SIGKILL));
  WAY("term", raise(SIGTERM));
  WAY("memory", eat());
  WAY("print", for (;;) puts("all work and no play"));
}
#define ON(call, name) end(name, #call)

enum { U, Y, REALS };
#define STATES 0
#define INPUTS (1u << U)
#define SLOPES_AT_ONCE 0
#include "small_fmu.h"

static void start_values(values *v) { UNUSED(v); }
static void derivatives(const values *v, double *dx) { UNUSED(v), UNUSED(dx); }
static void outputs(values *v) { v->r[Y] = 2 * v->r[U]; }
static fmi2Status step_status(unit *m, double t, double h) { return UNUSED(m), UNUSED(t), UNUSED(h), fmi2OK; }
