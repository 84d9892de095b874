// ViennaCL's conjugate gradients with its algebraic multigrid (smoothed aggregation), in double, on the host.
// It knows nothing of the three components of a node. One thread.
#include "bench/peers/linear_solver.h"

#ifdef TELETACT_BENCH_VIENNACL
#include <viennacl/compressed_matrix.hpp>
#include <viennacl/linalg/amg.hpp>
#include <viennacl/linalg/cg.hpp>
#include <viennacl/vector.hpp>

#include <optional>
#include <vector>

namespace teletact::bench {
namespace {

class Multigrid final : public LinearSolver {
 public:
  std::string name() const override { return "ViennaCL CG, multigrid"; }
  bool iterative() const override { return true; }
  void prepare(const Eigen::SparseMatrix<double>& k) override {
    const auto n = static_cast<std::size_t>(k.rows());
    // Symmetric: its columns are its rows.
    const std::vector<unsigned> rows(k.outerIndexPtr(), k.outerIndexPtr() + n + 1);
    const std::vector<unsigned> columns(k.innerIndexPtr(), k.innerIndexPtr() + k.nonZeros());
    matrix_.emplace(host_);
    matrix_->set(rows.data(), columns.data(), k.valuePtr(), n, n, static_cast<std::size_t>(k.nonZeros()));
    viennacl::linalg::amg_tag tag;
    tag.set_coarsening_method(viennacl::linalg::AMG_COARSENING_METHOD_MIS2_AGGREGATION);
    tag.set_interpolation_method(viennacl::linalg::AMG_INTERPOLATION_METHOD_SMOOTHED_AGGREGATION);
    tag.set_jacobi_weight(0.2);  // of 0.2, 0.4 and 1 the only one with which it converges
    tag.set_setup_context(host_);
    tag.set_target_context(host_);
    multigrid_.emplace(*matrix_, tag);
    multigrid_->setup();
  }
  Eigen::VectorXd solve(const Eigen::VectorXd& f, int iterations) override {
    viennacl::vector<double> right(static_cast<std::size_t>(f.size()), host_);
    viennacl::fast_copy(f.data(), f.data() + f.size(), right.begin());
    const viennacl::linalg::cg_tag tag(0, static_cast<unsigned>(iterations));
    const viennacl::vector<double> x = viennacl::linalg::solve(*matrix_, right, tag, *multigrid_);
    Eigen::VectorXd out(f.size());
    viennacl::fast_copy(x.begin(), x.end(), out.data());
    return out;
  }

 private:
  using Matrix = viennacl::compressed_matrix<double>;
  const viennacl::context host_{viennacl::MAIN_MEMORY};
  std::optional<Matrix> matrix_;
  std::optional<viennacl::linalg::amg_precond<Matrix>> multigrid_;
};

}  // namespace

std::unique_ptr<LinearSolver> make_viennacl_multigrid(std::string&) {
  return std::make_unique<Multigrid>();
}

}  // namespace teletact::bench

#else

namespace teletact::bench {

std::unique_ptr<LinearSolver> make_viennacl_multigrid(std::string& absent) {
  absent = "ViennaCL: its headers were not found when teletact was configured; install libviennacl-dev";
  return nullptr;
}

}  // namespace teletact::bench
#endif
