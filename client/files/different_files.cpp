#include "client/files/different_files.h"

#include <filesystem>
#include <stdexcept>
#include <system_error>

namespace teletact::client {
namespace {

bool same_file(const std::string& a, const std::string& b) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (fs::equivalent(a, b, error)) return true;
  const fs::path first = fs::weakly_canonical(a, error);  // of files that do not exist yet
  return !error && first == fs::weakly_canonical(b, error) && !error;
}

}  // namespace

void require_different_files(const std::vector<NamedFile>& files) {
  for (std::size_t k = 0; k < files.size(); ++k)
    for (std::size_t earlier = 0; earlier < k; ++earlier) {
      const NamedFile &a = files[earlier], &b = files[k];
      if (a.path.empty() || b.path.empty() || !same_file(a.path, b.path)) continue;
      throw std::runtime_error(b.purpose + " " + b.path + " is the same file as " + a.purpose + " (" +
                               a.path + "), and would destroy it; choose another file");
    }
}

}  // namespace teletact::client
