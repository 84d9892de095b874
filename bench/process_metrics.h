// What a service says of its own process, at the address of its `--admin`.
#pragma once

#include <map>
#include <string>

namespace teletact::bench {

// Values of /metrics that have no label, by name. `admin`: 127.0.0.1:PORT or unix:/path. Throws BenchError,
// which names
// --admin, when nobody answers there.
std::map<std::string, double> process_metrics(const std::string& admin);

}  // namespace teletact::bench
