// ViennaCL's OpenCL conjugate gradients with Jacobi, in double, on the same device, where its headers were
// found at configure time. `tolerance` is its own: the residual over that of the right-hand side.
#include "bench/peers/peer.h"

#ifdef TELETACT_BENCH_VIENNACL
#include <viennacl/compressed_matrix.hpp>
#include <viennacl/linalg/cg.hpp>
#include <viennacl/linalg/jacobi_precond.hpp>
#include <viennacl/ocl/backend.hpp>
#include <viennacl/ocl/platform.hpp>
#include <viennacl/vector.hpp>

#include <optional>

#include "bench/peers/prescribed.h"

namespace teletact::bench {
namespace {

constexpr std::size_t kMaxDofs = 15000;
constexpr unsigned kMaxIterations = 40000;
constexpr long kContext = 1;  // ViennaCL's number for the context on our device

// Makes ViennaCL work on the device of that name; false: it sees none.
bool choose_device(const std::string& name) {
  for (viennacl::ocl::platform& platform : viennacl::ocl::get_platforms())
    for (viennacl::ocl::device& device : platform.devices(CL_DEVICE_TYPE_ALL)) {
      if (device.name() != name) continue;
      viennacl::ocl::setup_context(kContext, device);
      viennacl::ocl::switch_context(kContext);
      return true;
    }
  return false;
}

class ViennaCl final : public Peer {
 public:
  std::string name() const override { return "ViennaCL CG, Jacobi"; }
  bool iterative() const override { return true; }
  std::size_t max_unknowns() const override { return kMaxDofs; }
  double prepare(const ContactProblem& p) override {
    if (of_ != describe(p.of)) {  // the matrix is given to a rival: not timed twice
      system_.emplace(p);
      of_ = describe(p.of);
    }
    const auto& a = system_->matrix;
    const std::vector<unsigned> rows(a.outerIndexPtr(), a.outerIndexPtr() + a.rows() + 1);
    const std::vector<unsigned> columns(a.innerIndexPtr(), a.innerIndexPtr() + a.nonZeros());
    matrix_.emplace();
    matrix_->set(rows.data(), columns.data(), a.valuePtr(), static_cast<std::size_t>(a.rows()),
                 static_cast<std::size_t>(a.cols()), static_cast<std::size_t>(a.nonZeros()));
    jacobi_.emplace(*matrix_, viennacl::linalg::jacobi_tag());
    right_.emplace(static_cast<std::size_t>(a.rows()));
    viennacl::fast_copy(system_->right.data(), system_->right.data() + system_->right.size(),
                        right_->begin());
    viennacl::backend::finish();
    return -1;
  }
  PeerAnswer touch(const ContactProblem& p, double tolerance) override {
    const viennacl::linalg::cg_tag tag(tolerance, kMaxIterations);
    const Vector x = viennacl::linalg::solve(*matrix_, *right_, tag, *jacobi_);
    Eigen::VectorXd solution(system_->right.size());
    viennacl::fast_copy(x.begin(), x.end(), solution.data());
    PeerAnswer answer;
    answer.iterations = tag.iters();
    answer.displacement_m = system_->displacement_m(p, solution);
    answer.force_n = PrescribedContact::force_n(p, answer.displacement_m);
    return answer;
  }

 private:
  using Matrix = viennacl::compressed_matrix<double>;
  using Vector = viennacl::vector<double>;
  std::string of_;
  std::optional<PrescribedContact> system_;
  std::optional<Matrix> matrix_;
  std::optional<viennacl::linalg::jacobi_precond<Matrix>> jacobi_;
  std::optional<Vector> right_;
};

}  // namespace

std::unique_ptr<Peer> make_viennacl(const std::shared_ptr<service::Device>& device, std::string& absent) {
  if (!device->info().has_double || !choose_device(device->info().name)) {
    absent = "ViennaCL: it does not see " + device->info().name + " with double precision";
    return nullptr;
  }
  return std::make_unique<ViennaCl>();
}

}  // namespace teletact::bench

#else

namespace teletact::bench {

std::unique_ptr<Peer> make_viennacl(const std::shared_ptr<service::Device>&, std::string& absent) {
  absent = "ViennaCL: its headers were not found when teletact was configured; install libviennacl-dev";
  return nullptr;
}

}  // namespace teletact::bench
#endif
