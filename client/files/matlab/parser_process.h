// The process in which a file of MATLAB or USTB is parsed: this program once more, which does nothing else.
// It inherits the file and a pipe for what it finds, and has limits; it writes no file. What it says is
// checked like any peer's words. No filter of system calls: which ones matio, HDF5 and a sanitizer make
// changes with their versions, and a good file would be refused after an update.
#pragma once

#include <chrono>
#include <cstddef>
#include <filesystem>
#include <string>

#include "client/files/matfile.h"
#include "client/files/uff.h"

namespace teletact::client {

struct ParserLimits {
  std::size_t address_bytes = std::size_t{4} << 30;  // of its whole address space; none with sanitizers
  std::chrono::seconds processor{60};                // that it may work
  std::chrono::seconds silence{120};                 // that a part of its answer may take
};

// As read_mat() and read_uff(); also throw FileError, with the remedy, where the parser crashes or reaches a
// limit.
MatFrames parse_mat_apart(const std::filesystem::path& path, const std::string& variable, AxialAxis axial,
                          const ParserLimits& limits = {});
UffImage parse_uff_apart(const std::filesystem::path& path, const std::string& object, std::size_t frame,
                         const ParserLimits& limits = {});

}  // namespace teletact::client
