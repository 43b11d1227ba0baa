/* Value references of FMI 3.0, where all types share one set: reals as in unit.h, then time, Integers, Booleans, event
 * indicators, which are variables there, and clocks. */
#ifndef COBOT_JOINT_REFERENCES_H
#define COBOT_JOINT_REFERENCES_H

#include "core/unit.h"

/* Integers and Booleans count from 1 on */
enum {
  FMI3_TIME = N_REAL,
  FMI3_INTEGER = N_REAL,
  FMI3_BOOLEAN = FMI3_INTEGER + N_INTEGER - 1,
  FMI3_INDICATOR = FMI3_BOOLEAN + N_BOOLEAN,
  FMI3_CLOCK = FMI3_INDICATOR + N_EVENT
};
enum ClockNumber {
#define CLOCK(name, ...) CLOCK_##name,
#define SAMPLE_CLOCK(name, ...) CLOCK_##name,
#include "core/rows.h"
  N_CLOCK
};

#endif
