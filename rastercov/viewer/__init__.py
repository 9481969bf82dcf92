"""Page in the browser to see a rig, move its cameras, and understand what they cover.

`open_scene` reads what is to be shown, `Session` edits and measures it without a server, `serve`
shows it on this machine, and `export_page` writes one file that needs no server.
"""
