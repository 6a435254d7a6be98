"""What a report of an identification rests on, as plain thinned values, and `report.json`.

May import the estimators and all left of them; of `report/` nothing else: nothing here knows how
it is shown.
"""
