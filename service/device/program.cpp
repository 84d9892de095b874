#include "service/device/program.h"

#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string_view>
#include <system_error>
#include <utility>

#include "common/small_file.h"

namespace teletact {
// Made at build time by cmake/embed.cmake: every .cl and .clh by file name.
const std::vector<std::pair<std::string_view, std::string_view>>& embedded_kernels();
}  // namespace teletact

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

std::string file_text(const std::string& file, const std::string& directory) {
  if (directory.empty()) {
    for (const auto& [name, text] : embedded_kernels())
      if (name == file) return std::string(text);
    throw DeviceError("no embedded kernel source " + file);
  }
  constexpr std::size_t kMaxBytes = std::size_t{1} << 20;
  const fs::path path = fs::path(directory) / file;
  try {
    return read_small_file(path, kMaxBytes);
  } catch (const UnreadFile& error) {
    throw DeviceError("cannot read kernel source " + path.string() + ": " + error.what());
  }
}

// The file named by a line `#include "x.clh"`, or empty.
std::string included_file(const std::string& line) {
  const std::size_t hash = line.find_first_not_of(" \t");
  if (hash == std::string::npos || line.compare(hash, 8, "#include") != 0) return {};
  const std::size_t open = line.find('"', hash), close = line.find('"', open + 1);
  if (open == std::string::npos || close == std::string::npos) return {};
  return line.substr(open + 1, close - open - 1);
}

void append(const std::string& file, const std::string& directory, std::set<std::string>& seen,
            std::string& out) {
  if (!seen.insert(file).second) return;
  out += "#line 1 \"" + file + "\"\n";
  std::istringstream lines(file_text(file, directory));
  std::string line;
  for (std::size_t number = 1; std::getline(lines, line); ++number) {
    const std::string included = included_file(line);
    if (included.empty()) {
      out += line + '\n';
    } else {
      append(included, directory, seen, out);
      out += "#line " + std::to_string(number + 1) + " \"" + file + "\"\n";
    }
  }
}

// FNV-1a, 64 bit.
std::uint64_t hash(std::string_view bytes, std::uint64_t seed) {
  std::uint64_t h = 14695981039346656037ULL ^ seed;
  for (const char c : bytes) h = (h ^ static_cast<unsigned char>(c)) * 1099511628211ULL;
  return h;
}

std::string hexadecimal(std::uint64_t value) {
  std::ostringstream text;
  text << std::hex << value;
  return text.str();
}

constexpr std::string_view kMagic = "teletact-kernel-1\n";

// File layout: magic, key length, key, binary length, hash of the binary (8 bytes each), binary.
std::string header(const std::string& key, std::string_view binary) {
  const auto number = [](std::uint64_t value) {
    std::string bytes(sizeof value, '\0');
    std::memcpy(bytes.data(), &value, sizeof value);
    return bytes;
  };
  return std::string(kMagic) + number(key.size()) + key + number(binary.size()) + number(hash(binary, 0));
}

}  // namespace

std::string program_source(const std::string& name, const std::string& directory) {
  std::string out;
  std::set<std::string> seen;
  append("real.clh", directory, seen, out);
  append(name + ".cl", directory, seen, out);
  return out;
}

std::string program_options(Precision precision, const Defines& defines) {
  std::string options = "-cl-std=CL1.2 -cl-mad-enable -DTELETACT_DOUBLE=";
  options += precision == Precision::kDouble ? "1" : "0";
  for (const auto& [name, value] : defines) options += " -D" + name + "=" + value;
  return options;
}

BinaryCache::BinaryCache(const std::string& directory) {
  if (directory == "none") return;
  directory_ = directory;
  if (!directory_.empty()) return;
  if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache && *cache)
    directory_ = std::string(cache) + "/teletact";
  else if (const char* home = std::getenv("HOME"); home && *home)
    directory_ = std::string(home) + "/.cache/teletact";
}

std::string BinaryCache::path(const std::string& key) const {
  if (directory_.empty()) return {};
  return directory_ + "/" + hexadecimal(hash(key, 0)) + hexadecimal(hash(key, 0x9e3779b97f4a7c15ULL)) +
         ".bin";
}

std::optional<std::vector<unsigned char>> BinaryCache::load(const std::string& key) const {
  if (directory_.empty()) return std::nullopt;
  constexpr std::size_t kMaxBytes = std::size_t{1} << 30;
  std::string all;
  try {
    all = read_small_file(path(key), kMaxBytes);
  } catch (const UnreadFile&) {  // a miss
    return std::nullopt;
  }
  const std::size_t head = kMagic.size() + key.size() + 3 * sizeof(std::uint64_t);
  if (all.size() <= head) return std::nullopt;
  const std::string_view binary = std::string_view(all).substr(head);
  if (all.compare(0, head, header(key, binary)) != 0) return std::nullopt;
  return std::vector<unsigned char>(binary.begin(), binary.end());
}

void BinaryCache::store(const std::string& key, const std::vector<unsigned char>& binary) const {
  if (directory_.empty() || binary.empty()) return;
  std::error_code error;
  fs::create_directories(directory_, error);
  std::string temporary = directory_ + "/new-XXXXXX";
  const int descriptor = mkstemp(temporary.data());
  if (descriptor < 0) return;
  close(descriptor);
  const std::string_view bytes(reinterpret_cast<const char*>(binary.data()), binary.size());
  std::ofstream file(temporary, std::ios::binary | std::ios::trunc);
  file << header(key, bytes) << bytes;
  file.close();
  if (file) fs::rename(temporary, path(key), error);
  if (!file || error) fs::remove(temporary, error);
}

}  // namespace teletact::service
