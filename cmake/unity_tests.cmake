# Writes OUT: the test files SOURCES as one, each unnamed namespace named after its file (teletact_unity_tests).
set(text "")
foreach(source ${SOURCES})
  get_filename_component(name ${source} NAME_WE)
  file(READ ${source} body)
  string(REPLACE "\nnamespace {\n" "\nnamespace in_${name} {\n" body "${body}")
  string(APPEND text "#line 1 \"${source}\"\n${body}")
endforeach()
file(WRITE ${OUT} "${text}")
