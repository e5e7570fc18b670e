"""Symmetric schemes of drifts (positions move) and kicks (velocities change) for q'' = f(q), from the literature."""

import dataclasses
import itertools


@dataclasses.dataclass(frozen=True)
class Scheme:
    """One step: drift d_0, then kick k_i and drift d_(i+1) in turn.  A first drift of 0 makes it begin with a kick."""

    name: str
    order: int
    drifts: tuple[float, ...]  # stages + 1
    kicks: tuple[float, ...]  # stages

    @property
    def stages(self) -> int:
        return len(self.kicks)


def mirrored(half, middle_twice: bool = False) -> tuple[float, ...]:
    """All coefficients, which add to 1, from the first ones: the last of the half or the middle is what is missing."""
    if middle_twice:
        half = (*half, 0.5 - sum(half))
        return (*half, *half[::-1])
    return (*half, 1 - 2 * sum(half), *half[::-1])


def composed(name: str, order: int, weights) -> Scheme:
    """Leapfrog steps (drift, kick, drift) of the given sizes, one after the other."""
    weights = mirrored(weights)
    drifts = [weights[0] / 2, *((a + b) / 2 for a, b in itertools.pairwise(weights)), weights[-1] / 2]
    return Scheme(name, order, tuple(drifts), weights)


LEAPFROG = Scheme("leapfrog", 2, (0.5, 0.5), (1.0,))

# Blanes & Moan 2002, SRKN 14 of order 6 for second-order equations: the least error for its stages.
BLANES_MOAN_6 = Scheme(
    "Blanes-Moan 6",
    6,
    mirrored(
        (
            0.0378593198406116,
            0.102635633102435,
            -0.0258678882665587,
            0.314241403071447,
            -0.130144459517415,
            0.106417700369543,
            -0.00879424312851058,
        )
    ),
    mirrored(
        (
            0.09171915262446165,
            0.183983170005006,
            -0.05653436583288827,
            0.004914688774712854,
            0.143761127168358,
            0.328567693746804,
        ),
        middle_twice=True,
    ),
)

# Kahan & Li 1997, 17 stages.
KAHAN_LI_8 = composed(
    "Kahan-Li 8",
    8,
    (
        0.13020248308889008087881763,
        0.56116298177510838456196441,
        -0.38947496264484728640807860,
        0.15884190655515560089621075,
        -0.39590389413323757733623154,
        0.18453964097831570709183254,
        0.25837438768632204729397911,
        0.29501172360931029887096624,
    ),
)

# Sofroniou & Spaletta 2005, 35 stages.
SOFRONIOU_SPALETTA_10 = composed(
    "Sofroniou-Spaletta 10",
    10,
    (
        0.07879572252168641926390768,
        0.31309610341510852776481247,
        0.02791838323507806610952027,
        -0.22959284159390709415121340,
        0.13096206107716486317465686,
        -0.26973340565451071434460973,
        0.07497334315589143566613711,
        0.11199342399981020988957508,
        0.36613344954622675119314812,
        -0.39910563013603589787862981,
        0.10308739852747107731580277,
        0.41143087395589023782070412,
        -0.00486636058313526176219566,
        -0.39203335370863990644808194,
        0.05194250296244964703718290,
        0.05066509075992449633587434,
        0.04967437063972987905456880,
    ),
)

# Steps of a run of 10 s of Figure 2's rod from coarse to fine, for errors of about 1e-3 .. 1e-12.
STEPS = {
    LEAPFROG: (25_000, 100_000, 400_000),
    BLANES_MOAN_6: (500, 800, 1600, 3200, 6400, 10_000),
    KAHAN_LI_8: (900, 1300, 2000, 3200, 5000, 7000),
    SOFRONIOU_SPALETTA_10: (700, 1000, 1400, 2000, 2800, 3600),
}
