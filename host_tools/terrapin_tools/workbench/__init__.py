"""The workbench: measurements against a model, where it fails, what it lacks.

One file a stage; imports run one way:
units, tables -> bases, case -> models -> fit -> noise -> directions, adequacy -> answer -> report, export.
"""
