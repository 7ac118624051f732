"""What a user writes becomes a checked value, and a value becomes text that can be read again.

yaml_tree    YAML text -> nodes that know their line
schema       what the annotation of a field asks of a file
building     nodes -> dataclasses, with all mistakes at once
loading      files -> dataclasses, the way in
writing      dataclasses -> YAML
spelling     British and American spelling
json_schema  dataclasses -> JSON Schema
json_data    JSON -> typed records
checked_lines  JSON lines with checksums
colours      colours by name
shipped      missions and robot models that come with the package
"""
