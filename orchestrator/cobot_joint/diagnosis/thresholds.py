"""Numbers that decide what a diagnosis says and that several modules share, with their sources.

Grids, step sizes and numbers of one module alone stand where they are used.

Sources: [count] the 500 drawn campaigns of docs/diagnosis-calibration.md, which count all of these together;
[naming] docs/decisions/0011-naming.md; docs/diagnosis-rules.md says what happened without it; others by name.
Excess: chi-square of means over 16 samples, less its expectation (estimation/problem.py).
"""

from __future__ import annotations

# -- whether something is left (three sigma: one healthy residual in 740 by chance)
LEFT_SIGMA = 3.0  # scatter of the excess, above which slow structure is left
LEFT_SHARE = 0.03  # of the samples, by which chi-square may exceed them: a noise's variance is known to 2 %
CLEARLY_LEFT = 10.0  # scatters of the excess, from which on something is looked for beyond the listed terms [naming]
HARDLY_LEFT = 5.0  # scatters, below which nothing is left that a fit could take or a place could hold [naming]
HARDLY_LEFT_SHARE = 0.005  # of what was above noise, the same [naming]
UNDECIDED = 30.0  # scatters, above which "nothing is missing" is not said though nothing was named [count]

# -- a listed term's evidence
EVIDENCE = 500.0  # chi-square that a term must take; linear scores of 400 healthy draws stay below 18 [count]
EVIDENCE_IN_TABLE = (
    30.0  # of some tens of rows: BIC of three numbers, 10, and 2 ln of some 1000 shapes tried, 14, and more
)
# Beside a background a name is as sure as the share that it takes, so that a small one claims nothing; what it predicts
# decides on the repair (AK80-9: 0.098 taken, the held-out error falls by a fifth).
LEAST = 0.04  # of what is above noise, that a first term must take to come nearest, and a further feature [naming]
# The next is the share of what a late onset leaves by which it must beat being there from the start: true ones did
# by 0.48 or more of chi-square, terms beside two backgrounds by 0.03 at most [naming].
WORTH = 0.1  # of what is above noise, that a later term must take, and a level of a variable hold [naming]
INEXACT = 3e-5  # of what was taken before, that a later term must take: no form is known to half a percent [naming]
STILL_NEEDED = 0.02  # of what an earlier term took, that it must take beside a later one [naming]
LATER = 60.0  # chi-square by which a late onset must beat being there from the start: 16 onsets, two sigma each [count]
MOST_TERMS = 4  # of a campaign; drawn ones have two at most [count]

# -- what cannot be told apart
COLLINEAR = 0.9995  # cosine from which on two responses are one: motor and gear friction have 1.000 [naming]
ALIKE = 30.0  # chi-square by which a term's fit may be worse and still not be told apart: five sigma of one number
ALIKE_SHARE = 0.05  # the same, as a share of the excess that the best fit leaves [naming]
MOST_NAMES = 4  # that one finding may carry: the scorers' rule, ../shared/score.py

# -- which fits are tried (they decide what is looked at)
PROMISING_SHAPE = 0.1  # of the best gain, that a term needs for other shapes to be tried: true ones had 0.39 [count]
# A load needs the next share of all above noise, as a term does for its onset to be refined: an onset follows a
# background, too [naming].
WORTH_FITTING = 0.3  # of the best predicted gain, that a term needs to be fitted: true ones had 0.39 [count]
ABREAST = 0.9  # of it, from which on twice as many are: their order says little [naming]
CLOSE = 0.98  # of a predicted gain that was kept, from which on another is tried all the same [naming]
HOPELESS = 0.6  # of what another takes, that a candidate falls short of for its onset to be left rough [naming]
NEAR_BEST = 0.3  # of what the best takes, by which a rough fit may be worse and still be finished [naming]
NEEDS_NO_FIT = 10.0  # times what is needed, by the Jacobian: no fit without the term has to ask [naming]
BEYOND_DOUBT = 100.0  # times the evidence, by the Jacobian: a few steps of a fit without the term tell [naming]
ENDED_EARLY = 0.1  # of what such a term takes, by which the fit before it may have ended early [naming]

# -- unmodelled effects: formulas and tables follow whatever the data show, so they must do more
REMAINDER = 0.1  # of the excess before, left by one term, below which the list explains the recordings [naming]
TERMS_STAND = 0.15  # of it, up to which listed terms stand, though the form of one may be somewhat off [naming]
TIMES_LESS = 3.0  # per feature, that a formula must leave in place of one listed term; a table than a formula [naming]
NO_PROOF = 0.02  # of the excess before, below which leaving less proves nothing [naming]
# A later term must also be predicted to take the next share: true ones were to take 0.95 or more, beside
# backgrounds the best 0.05 to 0.41 [naming].
HOLDS = 0.5  # of the remainder, that a form must take to be an answer, and a later term: a patch takes less [naming]
ALONE = 0.8  # of it, for a form or a load that needs no listed term beside it: terms would patch it [naming]
ENOUGH = 0.97  # of it, from which on no further forms or arguments are tried [naming]
TABLE_FREEDOM = 4  # features that a smooth table counts for: its effective degrees of freedom [naming]
NEAR_PORT = 0.5  # of the best port's gain, from which on a second one is looked at in full [naming]

EVEN = 0.5  # confidence, from which on a finding is a claim: the scorers' rule

# -- external loads and step offsets
BRIEF = 0.1  # of all the time, in which ...
HELD = (
    0.9  # ... so much of what is above noise lies, for it to be confined to short times; an offset takes that [naming]
)
APART = 0.3  # s without a difference, that part one load from the next: a hand takes as long to let go and grip again
LOADS_TAKE = 0.98  # of it, that load pulses must take, which have five numbers each [naming]
UNLOGGED = 1.1  # weight of an input of the system that nobody logged: it is there for something to enter [naming]

# -- where: replayed parts, operating conditions, change points
NOISE_KNOWN = 0.1  # share to which a part's healthy excess is known from three draws
SHOWS = 0.1  # of a channel's noise, rms, within which a signal is what the channel shows: a hundredth of its variance
SIGMA_KNOWN = 0.01  # share to which a noise's variance is known: 20,000 samples
SAME_CONDITION = 0.97  # of the time that two variables are at the same level, from which on one of them is enough
NOTABLE_CHANGE = 0.25  # of the chi-square per sample: less is no change that anyone would see
UNEVEN = 0.1  # nats of dependence (Kullback and Leibler 1951) from which on a variable is worth naming
STANDS_OUT = 6.0  # sigma, from which on a part is off or an order is named: of twelve by chance one in 10^8
CHANGE = 10.0  # times ln(windows): penalty of a change point, above the 2 ln n of BIC (Yao 1988): windows are dependent

# -- whether a repair is offered
NO_WORSE = (
    1.02  # times the error above noise without it, up to which a repair counts as no worse: the field scorers' rule
)
NEGLIGIBLE = 0.05  # of the noise's variance, summed over channels: an error that nobody can see
WITHHELD = 0.45  # confidence at most where a repair is withheld, time cut a search short, or an input may have frozen:
# less than even, no claim

# -- experiments, frequency responses
SEPARATES = 100.0  # predicted chi-square, ten sigma, from which on an experiment is worth doing
LOOK_ELSEWHERE = 10.0  # chi-square beyond the 2 ln(terms) that the best of so many takes by chance (extreme value)
INDISTINGUISHABLE = 4.0  # chi-square, two sigma, by which a term may fit amplitudes worse and not be told apart

# -- beside a background (diagnosis/anchored): nats of evidence
ANCHORED_EVIDENCE = 8.0  # that a term must have
ANCHORED_ALIKE = 5.0  # by which another may have less and not be told apart, and a recording contradict: odds of 150
ANCHORED_ALIKE_SHARE = 0.01  # the same, as a share: no form is known exactly
# The next is by one drawn machine of sixty, in which a false torque ripple had 0.14 beside a true cogging.
ANCHORED_LATER = 0.2  # of the most that a term has or predicts, that a later one needs: no form is known exactly
