/* One expansion of a unit's table: define the rows you want, include this, and every other row vanishes.
 * All rows are undefined again afterwards, so a file may expand the table as often as it likes. No include guard. */
#ifndef UNIT /* (name, title, description) */
#define UNIT(...)
#endif
#ifndef PART /* (term, title, equation, source): physics that is always there */
#define PART(...)
#endif
#ifndef TERM /* (term, title, equation, source, amplitude parameter, neutral value): physics that can be switched off */
#define TERM(...)
#endif
#ifndef PARAMETER /* (term, name, unit, start, min, max, description) */
#define PARAMETER(...)
#endif
#ifndef SHAPE /* (term, name, unit, start, min, max, scan from, scan to, lin|log, points, description) */
#define SHAPE(...)
#endif
#ifndef CHOICE /* (term, name, start, "first|second|...", description): an Integer whose values, from 1 on, have names */
#define CHOICE(...)
#endif
#ifndef COUNT /* (term, name, start, min, max, description): integer parameter */
#define COUNT(...)
#endif
#ifndef INPUT /* (name, unit, start, nominal, description) */
#define INPUT(...)
#endif
#ifndef SWITCH /* (name, start, description): Boolean input */
#define SWITCH(...)
#endif
#ifndef STATE /* (name, unit, nominal, output|local, description): error-controlled; its start value may be set */
#define STATE(...)
#endif
#ifndef INTEGRAL /* (name, unit, nominal, description): an output that nothing depends on, carried along with the states */
#define INTEGRAL(...)
#endif
#ifndef OUTPUT /* (name, unit, nominal, "inputs fed through", description) */
#define OUTPUT(...)
#endif
#ifndef CODE /* (name, min, max, "inputs fed through", description): integer output */
#define CODE(...)
#endif
#ifndef SIGNAL /* (name, "inputs fed through", description): Boolean output */
#define SIGNAL(...)
#endif
#ifndef LOCAL /* (name, unit, nominal, description) */
#define LOCAL(...)
#endif
#ifndef BOUNDS /* (name, min, max): of a state or an input that may not take every value */
#define BOUNDS(...)
#endif
#ifndef FIXED /* (parameter): term_name of one that no unit changes while it runs: geometry, inertia, sampling */
#define FIXED(...)
#endif
#ifndef EVENT /* (name, description): an indicator that equations.c gives; the event is where it turns positive */
#define EVENT(...)
#endif
#ifndef CLOCK /* (name, when z[N_EVENT] says that it ticks, description): an output clock of FMI 3.0 */
#define CLOCK(...)
#endif
#ifndef SAMPLE_CLOCK /* (name, description): an input clock of FMI 3.0 that tells when to sample, every SAMPLE_PERIOD */
#define SAMPLE_CLOCK(...)
#endif
#ifndef MEMORY /* (type, name, count): discrete memory of the unit, part of the FMU state */
#define MEMORY(...)
#endif
#ifndef FLANGE /* (name, phi, w, tau, W, W_abs, gives|takes): a mechanical port */
#define FLANGE(...)
#endif
#ifndef HELD_TORQUE /* (tau, phi, w, gives|takes, J, c, late, answer): an input whose neighbour is a spring c: held.h */
#define HELD_TORQUE(...)
#endif

#ifndef SAMPLES_STEPS /* (what): the unit takes its samples at communication points, so model exchange has no place for it */
#define SAMPLES_STEPS(...)
#endif

#include MODEL_DEF

#undef UNIT
#undef PART
#undef TERM
#undef PARAMETER
#undef SHAPE
#undef CHOICE
#undef COUNT
#undef INPUT
#undef SWITCH
#undef STATE
#undef INTEGRAL
#undef OUTPUT
#undef CODE
#undef SIGNAL
#undef LOCAL
#undef BOUNDS
#undef FIXED
#undef EVENT
#undef CLOCK
#undef SAMPLE_CLOCK
#undef MEMORY
#undef FLANGE
#undef HELD_TORQUE
#undef SAMPLES_STEPS
