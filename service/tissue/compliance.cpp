#include "service/tissue/compliance.h"

#include <algorithm>
#include <iterator>

namespace teletact::service {

Eigen::VectorXd Compliance::axial_under(std::span<const std::size_t> at, std::span<const std::size_t> loaded,
                                        const Eigen::Matrix2Xd& force_n_m) {
  std::vector<std::size_t> all;
  std::ranges::set_union(at, loaded, std::back_inserter(all));
  const auto position = [&](std::size_t node) {
    return 2 * Eigen::Index(std::ranges::lower_bound(all, node) - all.begin());
  };
  const Eigen::MatrixXd s = among(all, nullptr);
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(Eigen::Index(at.size()));
  for (std::size_t a = 0; a < at.size(); ++a)
    for (std::size_t b = 0; b < loaded.size(); ++b)
      moved[Eigen::Index(a)] +=
          s.block<1, 2>(position(at[a]) + 1, position(loaded[b])).dot(force_n_m.col(Eigen::Index(b)));
  return moved;
}

}  // namespace teletact::service
