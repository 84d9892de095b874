// A file of access in a folder of its own, and what its entries look like.
#pragma once

#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <string>

#include "service/access/access_table.h"

namespace teletact::service {

class AccessFolder {
 public:
  AccessFolder() {
    static std::atomic<int> count{0};
    path_ = std::filesystem::temp_directory_path() /
            ("teletact-access-" + std::to_string(getpid()) + "-" + std::to_string(count++));
    std::filesystem::create_directories(path_);
  }
  ~AccessFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  AccessFolder(const AccessFolder&) = delete;
  AccessFolder& operator=(const AccessFolder&) = delete;

  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }
  // As a careful hand writes it: beside, then renamed.
  std::filesystem::path put(const std::string& name, const std::string& text) const {
    const std::filesystem::path path = path_ / name, beside = path_ / (name + ".new");
    std::ofstream(beside, std::ios::binary) << text;
    std::filesystem::rename(beside, path);
    return path;
  }

 private:
  std::filesystem::path path_;
};

inline std::string hex_of(const Digest& digest) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string out;
  for (const unsigned char byte : digest) {
    out += kDigits[byte >> 4];
    out += kDigits[byte & 15];
  }
  return out;
}

// Of the role for every scene, known by the token "NAME-token" and by a certificate of its name.
inline std::string entry_of(const std::string& name, const std::string& role, const std::string& more = "") {
  return "[[entry]]\nname = \"" + name + "\"\ntoken_sha256 = \"" + hex_of(digest_of(name + "-token")) +
         "\"\ncertificate = \"" + name + "\"\nroles = { \"*\" = \"" + role + "\" }\n" + more;
}

}  // namespace teletact::service
