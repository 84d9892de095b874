# Writes OUT: teletact::embedded_NAME(), every source as raw strings by file name; a compiler takes some 64 kB in one.
set(text "#include <string_view>\n#include <utility>\n#include <vector>\n\nnamespace teletact {\nconst std::vector<std::pair<std::string_view, std::string_view>>& embedded_${NAME}();\nconst std::vector<std::pair<std::string_view, std::string_view>>& embedded_${NAME}() {\n  static const std::vector<std::pair<std::string_view, std::string_view>> table = {\n")
foreach(source ${SOURCES})
  get_filename_component(name ${source} NAME)
  file(READ ${source} body)
  string(APPEND text "    {\"${name}\", R\"CLC(${body})CLC\"},\n")
endforeach()
string(APPEND text "  };\n  return table;\n}\n}  // namespace teletact\n")
file(WRITE ${OUT} "${text}")
