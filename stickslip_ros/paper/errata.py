# SPDX-License-Identifier: Apache-2.0
"""The mistakes in the paper, and what is used instead; docs/paper_errata.md says the same."""

from __future__ import annotations

#: where, printed, used, why: texts with `code` and [links](to other pages of docs) as there
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
    (
        "Eq. 13",
        "n = 1e-8 m/N",
        "1e-8 m",
        "only so 1 N gives the 30 nm of the text",
    ),
    (
        "section 4.1.2",
        "70 to 600 N/mm2",
        "kN/mm2",
        "as in Table 3",
    ),
    (
        "after Eq. 9",
        "160 - 30 - 30 = 90 nm",
        "100 nm",
        "arithmetic",
    ),
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
        "9e6 N/m ring at 7.5 kHz with 4 g, Table 1 measures 4 kHz (2.5e6 N/m by Eq. 11): fit "
        "to forces and fit to vibration disagree",
    ),
    (
        "Eq. 16",
        "no value for sigma_0,ss",
        "1e7 N/m",
        "the drive of Table 1 then steps 134 nm (paper 130 nm), and steps end near 5 N (paper"
        " about 5 N)",
    ),
    (
        "Eq. 7 with Table 2, EPM_fix",
        "g(v) below the fraction, z_ss fixed",
        "the fixed z_ss is the limit too",
        "Eq. 8 takes them for the same, but then the step no longer depends on the preload "
        "and Fig. 5 does not come out for this law",
    ),
    (
        "Eq. 9",
        "step = excitation - backstep - 0-amplitude",
        "the same, with the remainder told, and what ringing regains of the backstep",
        "a runner that rings falls past its new rest: at 0.4 N by 48 nm, 22 nm of it "
        "regained, so 160 - 134 - 48 leaves -22 nm to a 0-amplitude of 21 nm",
    ),
    (
        "section 4.1",
        "0-amplitude and z_ba are the same",
        "z_ba = 0-amplitude / 1.14 for z_ss = 2 z_ba",
        "steps just above z_ba are too small to measure, see [derivations.md](derivations.md)",
    ),
    (
        "Table 3",
        'steel 1.4112, "HRW 55"',
        "55 on the Rockwell scale",
        "presumably HRC",
    ),
    (
        "Eq. 21 with 30",
        "moments of friction in Eq. 21, none in row 4 of Eq. 30",
        "as in Eq. 30",
        "only so A = C and B = D, as in Table 5",
    ),
    (
        "Eq. 24 to 26",
        "1/mu below sqrt(2) m g sin(alpha), and five entries for six rows",
        "1/mu with row 3, (m/mu)(z'' + g cos(alpha)), as Eq. 19 has it",
        "row 2 is Eq. 18, which has no friction in it",
    ),
    (
        "Eq. 29",
        "Q = -(m/mu)(z'' + g cos(alpha), the bracket left open",
        "sum of normal forces = (m/mu)(z'' + g cos(alpha))",
        "Q is called a friction force; by Eq. 19 that is mu times the sum, without 1/mu and minus",
    ),
    (
        "Eq. 30",
        "seven rows for six forces",
        "row (i, -i, i, i, 0, 0) left out",
        "it belongs to no balance",
    ),
    (
        "Table 4",
        "missing from our copy",
        "m = 3 g, alpha = 90 degrees, (a - b)/(2e) = 0.9276, f = 0.2 N",
        "these give Table 5 to its last digit",
    ),
    (
        "Table 5",
        '2.8 "due to geometric conditions"',
        "2 sqrt(2)",
        "by Eq. 17 and 27 the sum is 2 (E + F) = 2 sqrt(2) f, whatever a, b, c, e, m and alpha",
    ),
)
