"""The studio: a page on which a person drags the lens and sees the rays and the response change.

A thin door: `document` holds the design that is worked on, `answers` calls the stages, `session` takes what one page
asks, newest first, `guard` keeps strangers out, `server` serves the page of ``page/``, which is built from ``web/``.
`frames` is the form of what is sent; `export` writes a page that needs no server.
"""
