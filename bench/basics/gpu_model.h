// How long a GPU would take for what a queue asks of it: a model, no measurement.
#pragma once

namespace teletact::bench {

// Of an H100. On record are iterations of 18 launches, a wait and 70 k serial terms in 0.7 to 1.3 ms, and of
// 336 k terms in 3 to 5 ms: with a term of 12 ns they take 1.0 and 4.2 ms.
struct GpuModel {
  double launch_s = 6e-6, wait_s = 15e-6, term_s = 12e-9, memory_bytes_s = 2.5e12, link_bytes_s = 12e9;
  // terms: those of all launches that an item adds one after the other. moved: bytes of the device's memory;
  // sent: of the link, both ways.
  double seconds(double launches, double waits, double terms, double moved, double sent) const {
    return launches * launch_s + waits * wait_s + terms * term_s + moved / memory_bytes_s +
           sent / link_bytes_s;
  }
};

}  // namespace teletact::bench
