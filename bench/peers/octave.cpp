// GNU Octave, the paper's stack, where a person has installed it: a generated script reads the matrix, solves
// the KKT system (T4.1) by its backslash, dense up to the paper's sizes and sparse beyond, and prints the
// times that it measured itself.
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>

#include "bench/peers/peer.h"

namespace teletact::bench {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxDenseDofs = 2200, kMaxDofs = 30000;

constexpr const char* kScript = R"(load('-ascii', 'k.txt'); load('-ascii', 'contact.txt');
K = spconvert(k); n = rows(K); m = rows(contact);
s = full(max(abs(diag(K))));
B = sparse(1:m, contact(:, 1), s, m, n);
A = [K, B'; B, sparse(m, m)];
if n <= %d
  A = full(A);
end
b = [zeros(n, 1); s * contact(:, 2)];
for t = 1:3
  tic; x = A \ b; seconds(t) = toc;
end
printf('%%.17g\n', median(seconds), s * x(n + 1:end));
)";

// Lines of numbers that a command prints; throws where it fails.
std::vector<double> numbers_from(const std::string& command) {
  FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr) throw std::runtime_error("octave could not be started");
  std::vector<double> numbers;
  std::array<char, 64> line{};
  while (std::fgets(line.data(), line.size(), pipe) != nullptr)
    numbers.push_back(std::strtod(line.data(), nullptr));
  if (pclose(pipe) != 0) throw std::runtime_error("octave failed: " + command);
  return numbers;
}

class Octave final : public Peer {
 public:
  ~Octave() override {
    std::error_code ignored;
    fs::remove_all(folder_, ignored);
  }
  std::string name() const override { return "Octave, KKT by backslash"; }
  std::size_t max_unknowns() const override { return kMaxDofs; }
  double prepare(const ContactProblem& p) override {
    fs::create_directories(folder_);
    std::ofstream k(folder_ / "k.txt"), contact(folder_ / "contact.txt"), script(folder_ / "solve.m");
    for (Eigen::Index column = 0; column < p.stiffness.outerSize(); ++column)
      for (Eigen::SparseMatrix<double>::InnerIterator it(p.stiffness, column); it; ++it)
        k << fmt::format("{} {} {:.17g}\n", it.row() + 1, it.col() + 1, it.value());
    for (std::size_t r = 0; r < p.contact_dofs.size(); ++r)
      contact << fmt::format("{} {:.17g}\n", p.contact_dofs[r] + 1,
                             p.overlap_m[static_cast<Eigen::Index>(r)]);
    std::array<char, 1024> text{};
    std::snprintf(text.data(), text.size(), kScript, static_cast<int>(kMaxDenseDofs));
    script << text.data();
    if (!k.flush() || !contact.flush() || !script.flush())
      throw std::runtime_error("cannot write to " + folder_.string());
    return 0;  // for each touch anew, as the paper's system does it
  }
  PeerAnswer touch(const ContactProblem& p, double) override {
    const auto numbers =
        numbers_from("cd '" + folder_.string() +
                     "' && OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 octave-cli -q solve.m 2>octave.log");
    const auto size = p.overlap_m.size();
    if (static_cast<Eigen::Index>(numbers.size()) != size + 1)
      throw std::runtime_error("octave printed something else than its answer");
    const Eigen::Map<const Eigen::VectorXd> multiplier(numbers.data() + 1, size);
    PeerAnswer answer;
    answer.force_n = p.force_n(multiplier);
    answer.seconds = numbers.front();
    return answer;
  }

 private:
  fs::path folder_ = fs::temp_directory_path() / fmt::format("teletact-bench-octave-{}", getpid());
};

}  // namespace

std::unique_ptr<Peer> make_octave(std::string& absent) {
  if (std::system("command -v octave-cli >/dev/null 2>&1") != 0) {
    absent = "Octave: octave-cli is not installed; it is the paper's stack, install it to compare";
    return nullptr;
  }
  return std::make_unique<Octave>();
}

}  // namespace teletact::bench
