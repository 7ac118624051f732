"""Reads users' files to checked values, and writes values as text that can be read again.

yaml_tree    YAML text -> nodes that know their line
schema       the annotations of fields
building     nodes -> dataclasses, with all mistakes at once
loading      files -> dataclasses; the entry point
writing      dataclasses -> YAML
spelling     British and American spelling
json_schema  dataclasses -> JSON Schema
json_data    JSON -> typed records
checked_lines  JSON lines with checksums
colours      colours by name
shipped      missions and robot models that come with the package
"""
