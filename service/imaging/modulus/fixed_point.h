// x <- G(x), hastened by what the last steps changed (Anderson, Journal of the ACM 12, 1965).
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstddef>
#include <deque>

namespace teletact::service {

class FixedPoint {
 public:
  // What to try after x, of which G(x) is `mapped`: the mix of the last steps that leaves the least.
  Eigen::VectorXd next(const Eigen::VectorXd& x, const Eigen::VectorXd& mapped) {
    const Eigen::VectorXd left = mapped - x;
    if (last_left_.size()) {
      steps_.push_back({left - last_left_, mapped - last_mapped_});
      if (steps_.size() > kDepth) steps_.pop_front();
    }
    last_left_ = left, last_mapped_ = mapped;
    const auto count = static_cast<Eigen::Index>(steps_.size());
    if (count == 0) return mapped;
    Eigen::MatrixXd of_left(x.size(), count), of_mapped(x.size(), count);
    for (Eigen::Index k = 0; k < count; ++k) {
      const Step& step = steps_[static_cast<std::size_t>(k)];
      of_left.col(k) = step.left, of_mapped.col(k) = step.mapped;
    }
    Eigen::MatrixXd normal = of_left.transpose() * of_left;
    normal.diagonal().array() += kRegular * normal.trace();
    return mapped - of_mapped * normal.ldlt().solve(of_left.transpose() * left);
  }

 private:
  static constexpr std::size_t kDepth = 3;  // more does not end it sooner
  static constexpr double kRegular = 1e-4;  // steps may be alike
  struct Step {
    Eigen::VectorXd left, mapped;  // by how much they changed
  };
  std::deque<Step> steps_;
  Eigen::VectorXd last_left_, last_mapped_;
};

}  // namespace teletact::service
