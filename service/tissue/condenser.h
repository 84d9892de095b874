// Condenses a problem onto its rows on the host, by the cheaper way (T4.2, T4.2c). Wide tissue is eliminated
// column by column, which costs the same for each row. Deep tissue, and from the fifth interior row on any
// tissue whose rows all fit the bound of memory, is eliminated row by row: two sweeps once and one dense
// inverse for each row.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "service/base/memory.h"
#include "service/tissue/column_condensation.h"
#include "service/tissue/compliance.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

struct CondenserOptions {
  bool interior_layers = false;          // keeps for them what the surface's elimination passes through
  bool will_change = false;              // keeps what a row's successor can take over
  std::size_t max_compliance_bytes = 0;  // all rows together, where they are made row by row
};

// Thread-safe, but for one row asked for by two threads at a time.
class Condenser {
 public:
  Condenser(std::shared_ptr<const TissueProblem>, const CondenserOptions&, MemoryAccount);
  const FreeNodes& free() const { return free_; }
  // Throws std::out_of_range where the row is fixed or absent.
  void check_free(std::size_t row) const;
  // `before` (may be null): of a problem of which this one is a change; parts that are the same are taken
  // over. The numbers are those without it, to the bit. Throws MemoryRefused.
  std::shared_ptr<Compliance> condense(std::size_t row, const Condenser* before);
  // What was kept for the row's successor is not needed any more.
  void forget(std::size_t row);
  std::size_t compliance_bytes() const;
  std::size_t sides_bytes() const;  // of what is kept for its successor
  double operations() const;        // in floating point, to condense a row

 private:
  bool by_columns(std::size_t row);
  std::size_t swept_bytes() const;
  std::size_t working_bytes() const;
  Eigen::MatrixXd swept(std::size_t row);
  CondensedSides same_sides(std::size_t row, const Condenser* before) const;

  const std::shared_ptr<const TissueProblem> problem_;
  const CondenserOptions options_;
  const MemoryAccount account_;
  const FreeNodes free_;
  const CondensationCost cost_;

  // Column by column.
  std::atomic<std::size_t> by_columns_ = 0;  // interior rows condensed so
  mutable std::mutex sides_mutex_;
  struct Sides {
    Charge charge;
    CondensedSides sides;
  };
  std::map<std::size_t, Sides> sides_;  // by row, where the modulus will change

  // Row by row.
  Charge swept_charge_;
  std::vector<Eigen::MatrixXd> below_;  // of the surface's elimination, where interior rows are foreseen
  std::once_flag swept_;
  std::vector<Eigen::MatrixXd> stiffness_;  // Schur complement of every free row; consumed row by row
};

}  // namespace teletact::service
