"""Where to hang a platform on fewer than six cables, and how to push it, so that its free swings
tell most of the body.
"""
