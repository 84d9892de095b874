// A command's files must not be one another: what it writes would destroy what it reads.
#pragma once

#include <string>
#include <vector>

namespace teletact::client {

// A file as a person named it: for which purpose ("--record", "the recording that is played"), and where.
struct NamedFile {
  std::string purpose;
  std::string path;  // empty: none was given
};

// Throws std::runtime_error, naming both purposes, when two of the files are one, also through links and
// other spellings: what is written would destroy what is read. Call before anything is opened for writing.
void require_different_files(const std::vector<NamedFile>& files);

}  // namespace teletact::client
