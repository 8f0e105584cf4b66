"""How good predicted two-hand affordances are: cases in ActAffordance's layout, methods, measures and the report.

`layout`, `cases` and `toras` read truth; `answers`, `folder_answers` and `stored` read what a method says; `measures`,
`compat`, `modes`, `calibration` and `bootstrap` are pure formulas; `score` joins them for one method, `report` for all.
"""
