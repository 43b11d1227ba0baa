/* A unit and all that it can do, but for the names that a version of FMI gives it. Knows no physics.
 * One translation unit per FMU: EQUATIONS names the unit's equations.c, MODEL_DEF its table, UNIT_GUID is its GUID. */
#ifndef COBOT_JOINT_CORE_H
#define COBOT_JOINT_CORE_H

#include "core/unit.h"

#include EQUATIONS

#include "core/continuous.h"
#include "core/life.h"
#include "core/states.h"
#include "core/steps.h"
#include "core/variables.h"

#endif
