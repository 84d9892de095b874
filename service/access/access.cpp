#include "service/access/access.h"

#include <spdlog/spdlog.h>
#include <sys/stat.h>

#include <utility>

#include "service/access/access_file.h"

namespace teletact::service {

Access::Access(std::filesystem::path file, Now now, std::chrono::milliseconds between)
    : file_(std::move(file)),
      now_(std::move(now)),
      seen_(seen_now()),
      table_(std::make_shared<const AccessTable>(read_access(file_))),
      watch_(between, "access_not_read", [this] { look(); }) {
  spdlog::info("event=access_read file=\"{}\" entries={}", file_.string(), table()->size());
}

std::shared_ptr<const AccessTable> Access::table() const {
  const std::lock_guard lock(mutex_);
  return table_;
}

void Access::log_refusal(const std::string& peer, const AccessRefused& refused) const {
  std::uint64_t more = 0;
  {
    const std::lock_guard lock(mutex_);
    const auto now = std::chrono::steady_clock::now();
    if (said_ != decltype(said_)() && now - said_ < std::chrono::seconds(1)) {
      ++unsaid_;
      return;
    }
    said_ = now;
    more = std::exchange(unsaid_, 0);
  }
  spdlog::warn("event=access_refused peer={} unsaid={} why=\"{}\"", peer, more, refused.what());
}

Access::Seen Access::seen_now() const {
  struct stat found {};
  if (::stat(file_.c_str(), &found) != 0) return {};
  return {found.st_dev, found.st_ino, found.st_size, found.st_mtim.tv_sec, found.st_mtim.tv_nsec};
}

void Access::look() {
  const Seen seen = seen_now();
  if (seen == seen_) return;
  auto table = std::make_shared<const AccessTable>(read_access(file_));
  spdlog::info("event=access_read file=\"{}\" entries={}", file_.string(), table->size());
  seen_ = seen;
  const std::lock_guard lock(mutex_);
  table_ = std::move(table);
  ++version_;
}

}  // namespace teletact::service
