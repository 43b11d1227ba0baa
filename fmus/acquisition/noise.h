/* White noise that follows from (seed, channel, number of the sample) alone, so that it needs no state of its own. */
#include "core/unit.h"

/* SplitMix64, Steele, Lea and Flood 2014, fig. 15 to 17 */
static inline uint64_t scrambled(uint64_t z) {
  z += 0x9e3779b97f4a7c15u;
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

/* standard normal, Box and Muller 1958 */
static inline double normal(int seed, int channel, uint64_t sample) {
  const uint64_t a = scrambled(scrambled(scrambled((uint64_t)seed) + (uint64_t)channel) + sample), b = scrambled(a);
  const double u1 = ((double)(a >> 11) + 1) / 9007199254740992.0, u2 = (double)(b >> 11) / 9007199254740992.0;
  return sqrt(-2 * log(u1)) * cos(2 * PI * u2);
}
