"""The workbench: measurements against a model, where it fails, what it lacks.

One file a stage, imports run one way: units, files -> case -> bases, models -> fit -> noise -> adequacy -> answer -> report.
"""
