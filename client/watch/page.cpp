#include "client/watch/page.h"

#include <utility>
#include <vector>

namespace teletact {
const std::vector<std::pair<std::string_view, std::string_view>>& embedded_page();  // client/watch/page
}

namespace teletact::client {

std::optional<PageFile> page_file(const std::string& name) {
  const char* const type = name.ends_with(".js")    ? "text/javascript; charset=utf-8"
                           : name.ends_with(".css") ? "text/css; charset=utf-8"
                                                    : "text/html; charset=utf-8";
  for (const auto& [file, text] : embedded_page())
    if (file == name) return PageFile{text, type};
  return std::nullopt;
}

}  // namespace teletact::client
