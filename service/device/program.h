// Kernel programs: their source text, their binaries on disk. Private to service/device, knows no cl::.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "service/device/device.h"

namespace teletact::service {

// Text of `name`.cl with real.clh before it and every `#include "x.clh"` replaced by that file, each file
// once; from `directory`, or from the embedded sources when that is empty. Throws DeviceError for a file that
// does not exist.
std::string program_source(const std::string& name, const std::string& directory);

// Compiler options of a program.
std::string program_options(Precision, const Defines&);

// Binaries by key (everything they depend on, as text). A missing, truncated or foreign file is a miss; a
// store that fails is ignored: the cache only saves time.
class BinaryCache {
 public:
  // "" = $XDG_CACHE_HOME/teletact or ~/.cache/teletact; "none" = neither reads nor writes.
  explicit BinaryCache(const std::string& directory);
  std::optional<std::vector<unsigned char>> load(const std::string& key) const;
  void store(const std::string& key, const std::vector<unsigned char>& binary) const;
  // The file of a key; empty without a cache.
  std::string path(const std::string& key) const;

 private:
  std::string directory_;
};

}  // namespace teletact::service
