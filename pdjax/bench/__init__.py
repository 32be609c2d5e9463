"""Speed against accuracy, measured: the cases of `pdjax bench`, what they share, and `advise`, which reads their rows.

A case is one small file with a plan (what to measure, row by row) and a drawing; the table `cases.CASES` names them.
Nothing here is imported by the rest of the package but `advise`, which needs neither a case nor a picture.
"""
