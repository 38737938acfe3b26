"""The studio: a page on which the user drags parts of a design and sees rays and response change.

`document` stores the edited design, `replies` calls the stages, `session` handles the requests of one page, newest
first, `guard` rejects requests from elsewhere, and `server` serves the page in ``page/``, which is built from ``web/``.
`frames` defines the binary messages. The tabs next to the design run commands: `page_commands` describes them, `calls`
runs them, `jobs` runs them in the background, and `workspace` and `storage` manage their files.
"""
