"""The report of a run, or of two side by side: one HTML file that needs no network."""

#: File of a run's report in its folder.
REPORT_NAME = "report.html"
#: File of a comparison in the folder of the first run.
COMPARISON_NAME = "comparison.html"
