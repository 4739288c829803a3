"""The pages of this folder as a site: `make docs`. Nothing in it comes from elsewhere when it is read."""

project = "Terrapin"
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "Terrapin"
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
myst_heading_anchors = 3
pygments_style = "friendly"
pygments_dark_style = "github-dark"
