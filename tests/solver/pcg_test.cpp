// Conjugate gradients on the device against the same in plain double loops, and how they stop.
#include "service/solver/pcg.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "service/solver/linear_operator.h"
#include "service/solver/multigrid.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

// M = identity.
template <class T>
class NoPreconditioner : public LinearOperator<T> {
 public:
  explicit NoPreconditioner(const Queue& queue) : queue_(queue) {}
  void apply(const Array<T>& r, Array<T>& z, std::size_t) override { queue_.copy(r, z); }

 private:
  Queue queue_;
};

// A stencil, its operator and conjugate gradients for it.
template <class T>
struct Problem {
  Problem(std::size_t nx, std::size_t ny, std::size_t count, const PcgOptions& options, double sign = 1)
      : queue(test_device()->queue()),
        stencil(random_stencil(nx, ny, 10, 1)),
        pcg(queue, stencil.unknowns(), count, options) {
    for (double& value : stencil.blocks) value *= sign;
    set_operator();
    x = queue.array<T>(stencil.unknowns() * count);
  }
  void set_operator() {
    a = std::make_unique<StencilOperator<T>>(queue, std::make_shared<Array<T>>(queue.array(stencil.as<T>())),
                                             stencil.nx, stencil.ny);
  }
  void set_diagonal(const VectorXd& values) {
    std::ranges::fill(stencil.blocks, 0);
    for (std::size_t n = 0; n < stencil.nodes(); ++n)
      for (std::size_t c = 0; c < 2; ++c)
        stencil.blocks[4 * (4 * stencil.nodes() + n) + 3 * c] = values[static_cast<Eigen::Index>(2 * n + c)];
    set_operator();
  }
  std::vector<PcgResult> solve(const MatrixXd& b, LinearOperator<T>& m) {
    auto r = upload<T>(queue, b), load = upload<T>(queue, b);
    return pcg.solve(*a, m, static_cast<std::size_t>(b.cols()), r, load, x);
  }
  MatrixXd answer(Eigen::Index count) const { return download(queue, x, pcg.capacity()).leftCols(count); }
  VectorXd answer_of_one() const { return answer(1).col(0); }
  // Largest entry; never small when something is not a number.
  static double largest(const VectorXd& v) {
    return v.allFinite() ? v.lpNorm<Eigen::Infinity>() : std::numeric_limits<double>::infinity();
  }
  Queue queue;
  BlockStencil stencil;
  std::unique_ptr<StencilOperator<T>> a;
  Pcg<T> pcg;
  Array<T> x;
};

template <class T>
class Pcg_ : public testing::Test {
 protected:
  void SetUp() override {
    if (!test_device()->queue().supports(precision_of<T>)) GTEST_SKIP() << "device without double precision";
  }
};
using Types = testing::Types<float, double>;
TYPED_TEST_SUITE(Pcg_, Types);

TYPED_TEST(Pcg_, IteratesMatchPlainLoops) {
  using T = TypeParam;
  PcgOptions options;
  options.max_iterations = 5;
  options.relative_error = 0;
  Problem<T> p(7, 122, 2, options);  // several chunks of the inner products, the last ragged and not all held
  NoPreconditioner<T> m(p.queue);
  const MatrixXd a = p.stencil.dense(), b = random_vectors(p.stencil, 2, 2);
  const auto results = p.solve(b, m);
  for (Eigen::Index q = 0; q < 2; ++q) {
    VectorXd x = VectorXd::Zero(a.rows()), r = b.col(q), d = r;
    double decrease = 0;
    for (int k = 0; k < 5; ++k) {
      const double alpha = r.squaredNorm() / d.dot(a * d), old = r.squaredNorm();
      x += alpha * d;
      r -= alpha * a * d;
      d = r + r.squaredNorm() / old * d;
      decrease += alpha * old;
    }
    const double tolerance = 1e3 * std::numeric_limits<T>::epsilon();
    const PcgResult& result = results[static_cast<std::size_t>(q)];
    EXPECT_LE(p.largest(p.answer(2).col(q) - x), tolerance * p.largest(x));
    EXPECT_EQ(result.iterations, 5u);
    EXPECT_EQ(result.reason, StopReason::kIterationLimit);
    EXPECT_NEAR(result.recursive_residual / r.norm(), 1, tolerance);
    EXPECT_NEAR(result.squared_decrease / decrease, 1, tolerance);
    EXPECT_NEAR(result.squared_energy / x.dot(a * x), 1, tolerance);
  }
}

TYPED_TEST(Pcg_, ErrorEstimateStopsNearTheTrueEnergyError) {
  using T = TypeParam;
  PcgOptions options;
  options.relative_error = 1e-3;
  Problem<T> p(41, 30, 3, options);
  std::vector<double> lines[2];
  for (std::size_t i = 0; i < 41; ++i) lines[0].push_back(static_cast<double>(i));
  for (std::size_t j = 0; j < 30; ++j) lines[1].push_back(static_cast<double>(j));
  Multigrid<T> m(p.queue, {lines[0], lines[1]});
  m.set_operator(p.queue.array(p.stencil.template as<T>()), p.stencil.free);
  NoPreconditioner<T> none(p.queue);
  const MatrixXd a = p.stencil.dense(), b = random_vectors(p.stencil, 3, 3), truth = a.llt().solve(b);
  for (LinearOperator<T>* preconditioner :
       {static_cast<LinearOperator<T>*>(&m), static_cast<LinearOperator<T>*>(&none)}) {
    const auto results = p.solve(b, *preconditioner);
    for (Eigen::Index q = 0; q < 3; ++q) {
      const PcgResult& result = results[static_cast<std::size_t>(q)];
      const VectorXd e = p.answer(3).col(q) - truth.col(q);
      const double energy = truth.col(q).dot(a * truth.col(q));
      EXPECT_EQ(result.reason, StopReason::kConverged);
      // Without preconditioner the error falls by fits and starts: the estimate is then rough.
      EXPECT_LE(std::sqrt(e.dot(a * e) / energy), preconditioner == &none ? 3e-3 : 1e-3);
      if (preconditioner == &none) {
        EXPECT_GE(std::sqrt(e.dot(a * e) / energy), 1e-4) << "it worked far too long";
      }
      EXPECT_NEAR(result.squared_energy / energy, 1, 1e-4);
    }
  }
}

// The last terms alone are a fraction of what a slow run has left: eigenvalues from 1 to 10^4, evenly on a
// logarithmic scale, take 70 iterations to an error of 0.3 and would by the terms stop at more than 0.6.
TYPED_TEST(Pcg_, ErrorEstimateHoldsWhereConvergenceIsSlow) {
  using T = TypeParam;
  PcgOptions options;
  options.relative_error = 0.3;
  Problem<T> p(20, 20, 1, options);
  const auto n = static_cast<Eigen::Index>(p.stencil.unknowns());
  const VectorXd eigenvalues = VectorXd::LinSpaced(n, 0, std::log(1e4)).array().exp();
  p.set_diagonal(eigenvalues);
  NoPreconditioner<T> m(p.queue);
  const VectorXd b = VectorXd::Ones(n), truth = b.cwiseQuotient(eigenvalues);
  const PcgResult result = p.solve(b, m)[0];
  const VectorXd e = p.answer_of_one() - truth;
  const double squared_error = e.dot(eigenvalues.cwiseProduct(e));
  const double relative_error = std::sqrt(squared_error / truth.dot(b));
  EXPECT_EQ(result.reason, StopReason::kConverged);
  EXPECT_LE(relative_error, 0.3);
  EXPECT_GE(relative_error, 0.2) << "it worked far too long";
  EXPECT_GE(result.squared_error, squared_error);
  EXPECT_LE(result.squared_error, 1.5 * squared_error);
}

TYPED_TEST(Pcg_, StopsAtAnAbsoluteErrorThatIsSmallEnough) {
  using T = TypeParam;
  PcgOptions options;
  options.relative_error = 0;
  Problem<T> p(21, 16, 1, options);
  NoPreconditioner<T> m(p.queue);
  const MatrixXd a = p.stencil.dense(), b = random_vectors(p.stencil, 1, 9), truth = a.llt().solve(b);
  const double absolute = 1e-3 * std::sqrt(truth.col(0).dot(a * truth.col(0)));
  auto r = upload<T>(p.queue, b), load = upload<T>(p.queue, b);
  const auto results = p.pcg.solve(*p.a, m, 1, r, load, p.x, {}, {absolute});
  const VectorXd e = p.answer_of_one() - truth.col(0);
  EXPECT_EQ(results[0].reason, StopReason::kConverged);
  EXPECT_LE(std::sqrt(e.dot(a * e)), 3 * absolute);
  EXPECT_GE(std::sqrt(e.dot(a * e)), 0.1 * absolute) << "it worked far too long";
}

TYPED_TEST(Pcg_, ManyRightHandSidesAnswerAsOneByOne) {
  using T = TypeParam;
  PcgOptions options;
  options.relative_error = 0;
  options.relative_residual = 1e-4;
  Problem<T> p(21, 16, 5, options);
  NoPreconditioner<T> m(p.queue);
  MatrixXd b = random_vectors(p.stencil, 5, 4);
  b.col(2).setZero();
  b.col(3) *= 1e-3;
  const auto together = p.solve(b, m);
  const MatrixXd all = p.answer(5);
  for (Eigen::Index q = 0; q < 5; ++q) {
    const auto alone = p.solve(b.col(q), m);
    EXPECT_EQ(alone[0].iterations, together[static_cast<std::size_t>(q)].iterations) << q;
    EXPECT_EQ(alone[0].reason, StopReason::kConverged);
    EXPECT_LE(p.largest(p.answer_of_one() - all.col(q)),
              1e-12 + 10 * std::numeric_limits<T>::epsilon() * p.largest(all.col(q)));
  }
  EXPECT_EQ(together[2].iterations, 0u);
  EXPECT_EQ(all.col(2).norm(), 0);
}

TEST(Pcg, IndefiniteOperatorIsToldNotLooped) {
  Problem<float> p(21, 16, 1, {}, -1);
  NoPreconditioner<float> m(p.queue);
  const auto results = p.solve(random_vectors(p.stencil, 1, 5), m);
  EXPECT_EQ(results[0].reason, StopReason::kIndefinite);
  EXPECT_EQ(results[0].iterations, 0u);
  EXPECT_EQ(p.answer(1).norm(), 0);
}

TEST(Pcg, NotANumberStopsItsOwnRightHandSideAlone) {
  PcgOptions options;
  options.relative_error = 0;
  options.relative_residual = 1e-4;
  Problem<float> p(21, 16, 3, options);
  NoPreconditioner<float> m(p.queue);
  MatrixXd b = random_vectors(p.stencil, 3, 6);
  b(5, 1) = std::numeric_limits<double>::quiet_NaN();
  const auto results = p.solve(b, m);
  EXPECT_EQ(results[0].reason, StopReason::kConverged);
  EXPECT_EQ(results[1].reason, StopReason::kNotFinite);
  EXPECT_EQ(results[2].reason, StopReason::kConverged);
  EXPECT_TRUE(p.answer(3).col(0).allFinite());
}

TEST(Pcg, OperatorThatOverflowsIsTold) {
  Problem<float> p(21, 16, 1, {}, 1e38);
  NoPreconditioner<float> m(p.queue);
  EXPECT_EQ(p.solve(1e10 * random_vectors(p.stencil, 1, 7), m)[0].reason, StopReason::kNotFinite);
}

// Beside the operator's and the preconditioner's launches, and a look at the states.
TEST(Pcg, AnIterationAsksLittleOfTheDevice) {
  constexpr std::size_t kFew = 4, kMore = 8;
  const auto work = [](std::size_t iterations) {
    PcgOptions options;
    options.relative_error = 0, options.max_iterations = iterations;
    Problem<float> p(121, 122, 8, options);  // as many chunks as there are at most
    NoPreconditioner<float> m(p.queue);
    const MatrixXd b = random_vectors(p.stencil, 8, 5);
    p.solve(b, m);
    p.queue.take_work();
    p.solve(b, m);
    return p.queue.take_work();
  };
  const DeviceWork few = work(kFew), more = work(kFew + kMore);
  EXPECT_LE(more.launches - few.launches, kMore * (1 + 7));
  EXPECT_LE(more.copies - few.copies, kMore);  // the preconditioner
  EXPECT_LE(more.waits - few.waits, kMore);
  EXPECT_LE(more.longest_chain, 1024u);
}

TEST(Pcg, TooManyRightHandSidesAreRefused) {
  Problem<float> p(21, 16, 1, {});
  NoPreconditioner<float> m(p.queue);
  EXPECT_THROW(p.solve(random_vectors(p.stencil, 2, 8), m), std::invalid_argument);
}

TEST(Ritz, SmallestValueIsTheSmallestEigenvalueAfterAFullRun) {
  // Conjugate gradients in plain loops on a diagonal matrix of five eigenvalues end after five steps.
  const VectorXd eigenvalues = (VectorXd(5) << 0.25, 0.6, 1, 2, 3.5).finished();
  VectorXd r = VectorXd::Ones(5), p = r;
  Lanczos lanczos;
  for (int k = 0; k < 5; ++k) {
    const VectorXd ap = eigenvalues.cwiseProduct(p);
    const double old = r.squaredNorm();
    lanczos.alpha.push_back(old / p.dot(ap));
    r -= lanczos.alpha.back() * ap;
    lanczos.beta.push_back(r.squaredNorm() / old);
    p = r + lanczos.beta.back() * p;
  }
  EXPECT_NEAR(smallest_ritz_value(lanczos), 0.25, 1e-8);
  EXPECT_EQ(smallest_ritz_value({}), 0);
}

}  // namespace
}  // namespace teletact::service
