/* Dry friction that holds: while a shaft is at rest friction takes whatever is applied, up to its level there (static friction);
 * beyond it the shaft slides in that direction until its speed is zero again. Both are events. Karnopp 1985, ASME J. Dyn. Syst.
 * Meas. Control 107(1), with located events in place of his band around zero. */
#ifndef COBOT_JOINT_STICK_H
#define COBOT_JOINT_STICK_H

enum { SMOOTH = 1, STICK };

/* direction in which a shaft of speed w slides; at rest it is held, until the event says otherwise */
static inline int sliding_of(double w, int before, bool begins) { return w > 0 ? 1 : w < 0 ? -1 : begins ? 0 : before; }

static inline double comes_to_rest(int sliding, double w) { return sliding != 0 ? -sliding * w : -1; }
static inline double breaks_away(int sliding, double applied, double level) {
  return sliding == 0 ? fabs(applied) - level : -1;
}

#endif
