#include "service/tissue/tissue_model.h"

#include <utility>
#include <vector>

#include "service/device/device.h"
#include "service/tissue/compliance_cache.h"
#include "service/tissue/condenser.h"
#include "service/tissue/iterative_compliances.h"

namespace teletact::service {
namespace {

std::size_t bytes_of(const TissueProblem& problem) {
  const TissueGrid& grid = problem.grid;
  return (grid.elements() + grid.nx() + grid.ny()) * sizeof(double);
}

}  // namespace

TissueModel::TissueModel(TissueGrid grid, Material material, Supports supports,
                         const TissueModelOptions& options, const TissueModel* before)
    : problem_(std::make_shared<const TissueProblem>(
          make_problem(std::move(grid), std::move(material), supports, options.thickness_m,
                       options.touch_begin_m, options.touch_end_m))),
      charge_(options.account.charge(Place::kHost, "models", bytes_of(*problem_))),
      condenser_(std::make_shared<Condenser>(
          problem_,
          CondenserOptions{options.interior_layers, options.will_change, options.max_compliance_bytes},
          options.account)),
      surface_(condenser_->free().first_row > 0
                   ? nullptr
                   : condenser_->condense(0, before ? before->condenser_.get() : nullptr)),
      interior_(std::make_shared<ComplianceCache>(
          problem_->grid.ny(),
          options.max_compliance_bytes / (condenser_->compliance_bytes() + condenser_->sides_bytes()),
          [condenser = condenser_](std::size_t row) { condenser->forget(row); })),
      iterative_(std::make_shared<IterativeCompliances>(problem_, options.account)) {
  options.account.add(Place::kHost, interior_);
  options.account.add(Place::kHost, iterative_);
}

TissueModel::~TissueModel() = default;

std::shared_ptr<Compliance> TissueModel::condensed(std::size_t row, const TissueModel* before) const {
  condenser_->check_free(row);
  if (row == 0) return surface_;
  return interior_->get(
      row, [&] { return condenser_->condense(row, before ? before->condenser_.get() : nullptr); });
}

std::shared_ptr<Compliance> TissueModel::made(std::size_t row) const {
  condenser_->check_free(row);
  return row == 0 ? surface_ : interior_->find(row);
}

std::shared_ptr<Compliance> TissueModel::iterative(std::size_t row,
                                                   const std::shared_ptr<Device>& device) const {
  condenser_->check_free(row);
  return iterative_->at(row, device);
}

std::size_t TissueModel::compliance_bytes() const {
  return condenser_->compliance_bytes();
}

double TissueModel::condensation_operations() const {
  return condenser_->operations();
}

void warm_iterative(const std::shared_ptr<Device>& device) {
  constexpr std::size_t kColumns = 120, kRows = 33;
  const TissueGrid grid{uniform_coordinates(0, 0.120, kColumns), uniform_coordinates(0, 0.040, kRows)};
  std::vector<double> poisson_ratios{0.49};
  if (!device->info().has_double) poisson_ratios.push_back(0.499);  // refined
  for (const double poisson_ratio : poisson_ratios) {
    const Material material{std::vector<double>(grid.elements(), 10e3), poisson_ratio};
    const TissueModel model(grid, material, {}, {});
    for (const std::size_t count : {1, 2}) {  // right-hand sides
      std::vector<std::size_t> nodes(count);
      for (std::size_t n = 0; n < count; ++n) nodes[n] = kColumns / 2 + 2 * n + count;
      model.iterative(0, device)->axial_among(nodes, nullptr);
    }
  }
}

}  // namespace teletact::service
