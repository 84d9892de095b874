#include "client/files/matfile.h"

#include "client/files/matlab/parser_process.h"

namespace teletact::client {

MatFrames read_mat(const std::filesystem::path& path, const std::string& variable, AxialAxis axial) {
  return parse_mat_apart(path, variable, axial);
}

}  // namespace teletact::client
