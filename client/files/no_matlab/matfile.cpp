// Instead of client/files/matlab in a client without matio: says what it takes to read such a file.
#include "client/files/matfile.h"

namespace teletact::client {

MatFrames read_mat(const std::filesystem::path& path, const std::string&, AxialAxis) {
  throw FileError(path,
                  "this client reads no .mat files; convert it to .mha, or build with -DTELETACT_MATLAB=ON");
}

}  // namespace teletact::client
