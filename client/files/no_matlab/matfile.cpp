// Instead of client/files/matlab in a client without matio and HDF5: says what it takes to read such a file.
#include "client/files/matfile.h"

#include "client/files/netcdf.h"
#include "client/files/uff.h"

namespace teletact::client {

MatFrames read_mat(const std::filesystem::path& path, const std::string&, AxialAxis) {
  throw FileError(path,
                  "this client reads no .mat files; convert it to .mha, or build with -DTELETACT_MATLAB=ON");
}

UffImage read_uff(const std::filesystem::path& path, const std::string&, std::size_t) {
  throw FileError(path,
                  "this client reads no .uff files; convert it to .mha, or build with -DTELETACT_MATLAB=ON");
}

bool write_netcdf(const std::filesystem::path&, const NetcdfContent&) {
  return false;
}

}  // namespace teletact::client
