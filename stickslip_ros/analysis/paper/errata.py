# SPDX-License-Identifier: Apache-2.0
"""The mistakes in the paper, and what is used instead; docs/paper_errata.md says the same."""

from __future__ import annotations

#: where, printed, used, why
ERRATA: tuple[tuple[str, str, str, str], ...] = (
    (
        "Eq. 5 with 6",
        "m x'' = +F with v_diff = x' - u'",
        "m x'' = -F",
        "as printed the contact would feed energy into the runner",
    ),
    (
        "Eq. 7 and 16",
        '"0 . abs(v)", "1 + v"',
        "alpha(z, w) abs(w)",
        "after Dupont et al., IEEE TAC 47 (2002) 787; without the abs the law is wrong for w < 0",
    ),
    ("Eq. 13", "n = 1e-8 m/N", "1e-8 m", "only so 1 N gives the 30 nm of the text"),
    ("section 4.1.2", "70 to 600 N/mm2", "kN/mm2", "as in Table 3"),
    ("after Eq. 9", "160 - 30 - 30 = 90 nm", "100 nm", "arithmetic"),
    (
        "Table 2, EPM_calc",
        "z_ss = 450 to 600 nm",
        "mu_s f / sigma_0 = 300 nm per N",
        "the printed range is that of f = 1.5 to 2 N",
    ),
    (
        "Eq. 14 against Table 1",
        "sigma_0* = 9e6 N/m at 0.4 N",
        "both, as two files in `config/`",
        "9e6 N/m ring at 7.5 kHz with 4 g, Table 1 measures 4 kHz (2.5e6 N/m by Eq. 11): fit to "
        "forces and fit to vibration disagree",
    ),
    (
        "Eq. 16",
        "no value for sigma_0,ss",
        "1e7 N/m",
        "the drive of Table 1 then steps 134 nm (paper 130 nm), and steps end near 5 N (paper "
        "about 5 N)",
    ),
    (
        "Eq. 7 with Table 2, EPM_fix",
        "g(v) below the fraction, z_ss fixed",
        "the fixed z_ss is the limit too",
        "Eq. 8 takes them for the same; the step then no longer depends on the preload. Fig. 5 "
        "shows a fall as of LuGre, which only Eq. 7 to the letter gives (`stickslip paper`)",
    ),
    (
        "Eq. 9",
        "0-amplitude and backstep both taken off",
        "nothing, it is not part of the law",
        "in the model the stroke less what a backstep loses for good is the step: the "
        "0-amplitude is in that loss already",
    ),
)
