#include "client/files/matfile.h"

#include "client/files/matlab/parser_process.h"
#include "client/files/uff.h"

namespace teletact::client {

MatFrames read_mat(const std::filesystem::path& path, const std::string& variable, AxialAxis axial) {
  return parse_mat_apart(path, variable, axial);
}

UffImage read_uff(const std::filesystem::path& path, const std::string& object, std::size_t frame) {
  return parse_uff_apart(path, object, frame);
}

}  // namespace teletact::client
