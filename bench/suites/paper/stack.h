// The paper's stack, as far as it can be run here (T6.2): a solver process behind TCP/IP that answers every
// displacement with the whole solution, by Gaussian elimination of the system with multipliers (T4.1). One
// connection on the loopback interface; the two ends are threads of this process.
#pragma once

#include <string>
#include <thread>
#include <vector>

#include "bench/peers/peer.h"

namespace teletact::bench {

class PaperStack {
 public:
  // Listens on a free port of 127.0.0.1 and connects. `solver` and `problem` outlive it. Throws BenchError.
  PaperStack(Peer& solver, const ContactProblem& problem);
  ~PaperStack();
  PaperStack(const PaperStack&) = delete;
  PaperStack& operator=(const PaperStack&) = delete;

  // One displacement there, the solution back: force on the finger, then every displacement. Throws
  // BenchError.
  std::vector<double> touch(double indentation_m);

 private:
  void serve();

  Peer& solver_;
  const ContactProblem& problem_;
  int listening_ = -1, near_ = -1, far_ = -1;
  std::thread server_;
};

}  // namespace teletact::bench
