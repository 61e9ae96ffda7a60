"""All that armctl holds of viser 1.1.1 beyond its documented calls. Nothing else touches its insides.

One file a concern: how it serves (``serving.py``), what its pages say (``messages.py``), a scene without a
server (``kept_scene.py``), and its page (``page.py``, with what scripts and styles hold of it: ``seam.js``,
``console.css``, ``file.css``). Each hook has a test that names it, ``tests/ui/test_viser_seam.py``.
"""
