// Who may do what, as the file of --access says now: looked at twice a second and taken over as a whole. One
// that cannot be read, or is wrong, changes nothing and is logged once. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>

#include "service/access/access_table.h"
#include "service/access/file_watch.h"
#include "service/base/paced_log.h"

namespace teletact::service {

// The file of --access, TOML: an array of tables [[entry]], each with a name, token_sha256 and/or
// certificate, roles, and optionally expires.
inline constexpr std::size_t kMaxAccessBytes = std::size_t{4} << 20;  // some 10,000 entries

// Throws std::runtime_error, one line: file, entry, key and remedy.
AccessTable read_access(const std::filesystem::path& file);

class Access {
 public:
  using Now = std::function<WallClock::time_point()>;

  // `now`: the time by which entries expire. `between`: two looks at the file. Throws std::runtime_error, one
  // line, for a file that cannot be used.
  explicit Access(std::filesystem::path file, Now now = WallClock::now,
                  std::chrono::milliseconds between = FileWatch::kLook);

  std::shared_ptr<const AccessTable> table() const;
  // Changes with the table: what was asked of an older one is to be asked again.
  std::uint64_t version() const { return version_.load(); }
  // How often the file was looked at since.
  std::uint64_t looks() const { return watch_.looks(); }
  WallClock::time_point now() const { return now_(); }
  // One line a second at most: `call`, key=value pairs, was refused.
  void log_refusal(const std::string& call, const AccessRefused&) const;

 private:
  // What a file that has changed differs in; all 0 where there is none.
  struct Seen {
    std::uint64_t device = 0, inode = 0;
    std::int64_t size = 0, changed_s = 0, changed_ns = 0;
    bool operator==(const Seen&) const = default;
  };
  Seen seen_now() const;
  void look();

  const std::filesystem::path file_;
  const Now now_;
  Seen seen_;  // before it was read: what was written meanwhile is seen at the next look
  mutable std::mutex mutex_;
  std::shared_ptr<const AccessTable> table_;
  std::atomic<std::uint64_t> version_{1};
  mutable PacedLog refusals_{"access_refused"};
  FileWatch watch_;  // last: it looks at all of these
};

}  // namespace teletact::service
