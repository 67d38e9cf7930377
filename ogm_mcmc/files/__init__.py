"""Files as such, before anybody asks what is in them.

Whatever comes from a user or from elsewhere passes one of these doors, each of which says in one
line what is wrong (file, what, what was expected) and takes memory only after it has looked at
how much is asked for: `user_paths`, `input_files`, `yaml_files`, `npz_files`, `image_files`.
What is written passes `output_files`: a file, or a set of files, is replaced as a whole.
Lines for people pass `saying`. Who writes may be told to stop, or be gone: `signals`, `processes`.
"""
