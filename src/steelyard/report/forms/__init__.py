"""How a document is shown: terminal, Markdown, and a page (template, style and scripts in `web/`).

May import `blocks/` and nothing of what documents speak of; one document gives the same bytes
in each form.
"""
