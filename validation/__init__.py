"""The source document's numbers beside the computed ones: what `docs/validation.md` is made from.

    python -m validation --out docs/validation.md

Each module looks at some sections of the document and gives rows; `page` puts them together.
"""
