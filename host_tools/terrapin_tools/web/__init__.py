"""The workbench in a browser: `terrapin web`. See docs/web.md."""
