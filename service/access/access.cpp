#include "service/access/access.h"

#include <fmt/format.h>
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
  refusals_.tell(PacedLog::Clock::now(),
                 [&] { return fmt::format("peer={} why=\"{}\"", peer, refused.what()); });
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
