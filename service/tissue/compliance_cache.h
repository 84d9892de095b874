// Compliances of the interior rows of a model that are kept, those used last, and bounds them: each is made
// once as long as somebody holds it or it is kept.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/tissue/compliance.h"

namespace teletact::service {

// Thread-safe.
class ComplianceCache final : public Reclaimable {
 public:
  // `forget` is told of rows that are not kept any more.
  ComplianceCache(std::size_t rows, std::size_t max_kept, std::function<void(std::size_t row)> forget);
  // That of the row, made if nobody holds it; `make` may throw.
  std::shared_ptr<Compliance> get(std::size_t row, const std::function<std::shared_ptr<Compliance>()>& make);
  // That of the row if it is kept, else null.
  std::shared_ptr<Compliance> find(std::size_t row);
  // Of the one that was used last; gives back the one used longest ago that nobody holds.
  std::uint64_t last_use() const override { return used_; }
  bool give_back() override;

 private:
  using Kept = std::vector<std::pair<std::size_t, std::shared_ptr<Compliance>>>;
  void keep(std::size_t row, const std::shared_ptr<Compliance>&);
  void drop(Kept::iterator);
  struct Row {
    std::mutex making;
    std::weak_ptr<Compliance> made;
  };
  const std::size_t max_;
  const std::function<void(std::size_t)> forget_;
  std::vector<Row> rows_;
  std::mutex mutex_;
  Kept kept_;  // the one used last first
  std::atomic<std::uint64_t> used_ = 0;
};

}  // namespace teletact::service
