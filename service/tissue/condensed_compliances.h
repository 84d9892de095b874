// The compliances of a problem's rows by condensation on the host, each by the cheaper way (T4.2, T4.2c).
// Wide tissue is eliminated column by column, which costs the same for each row. Deep tissue, and from the
// fifth interior row on any tissue whose rows all fit the bound of memory, is eliminated row by row: two
// sweeps once and one dense inverse for each row. The surface's is kept, of the interior rows (T4.4) those
// used last.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "service/base/memory.h"
#include "service/tissue/column_condensation.h"
#include "service/tissue/compliance.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

// Thread-safe.
class CondensedCompliances final : public Reclaimable {
 public:
  // Condenses onto the surface, unless that is fixed. `before` (may be null): those of a problem of which
  // this one is a change; while they are there what is the same is taken over. Throws MemoryRefused.
  CondensedCompliances(std::shared_ptr<const TissueProblem>, const TissueModelOptions&,
                       std::shared_ptr<const CondensedCompliances> before);
  // That of the row, condensed if nobody holds it and it is not kept. Throws MemoryRefused.
  std::shared_ptr<Compliance> at(std::size_t row);
  // That of the row if it is kept, else null.
  std::shared_ptr<Compliance> find(std::size_t row);
  // Gives back the interior row used longest ago that nobody holds.
  std::uint64_t last_use() const override { return used_; }
  bool give_back() override;

 private:
  using Kept = std::vector<std::pair<std::size_t, std::shared_ptr<Compliance>>>;
  struct Row {
    std::mutex making;
    std::weak_ptr<Compliance> made;
  };
  struct Sides {
    Charge charge;
    CondensedSides sides;
  };
  std::shared_ptr<Compliance> condense(std::size_t row);
  bool by_columns(std::size_t row);
  std::size_t compliance_bytes() const;  // of a row
  std::size_t sides_bytes() const;
  std::size_t swept_bytes() const;
  std::size_t working_bytes() const;
  Eigen::MatrixXd swept(std::size_t row);
  CondensedSides same_sides(std::size_t row) const;
  void drop(Kept::iterator);

  const std::shared_ptr<const TissueProblem> problem_;
  const TissueModelOptions options_;
  const std::weak_ptr<const CondensedCompliances> before_;
  const FreeNodes free_;
  const CondensationCost cost_;
  std::vector<Row> rows_;
  std::shared_ptr<Compliance> surface_;  // null where it is fixed
  std::atomic<std::uint64_t> used_ = 0;
  mutable std::mutex mutex_;            // of the next two
  Kept kept_;                           // of interior rows, the one used last first
  std::map<std::size_t, Sides> sides_;  // by row, column by column, where the modulus will change

  std::atomic<std::size_t> by_columns_ = 0;  // interior rows condensed column by column

  // Row by row.
  Charge swept_charge_;
  std::vector<Eigen::MatrixXd> below_;  // of the surface's elimination, where interior rows are foreseen
  std::once_flag swept_;
  std::vector<Eigen::MatrixXd> stiffness_;  // Schur complement of every free row; consumed row by row
};

}  // namespace teletact::service
