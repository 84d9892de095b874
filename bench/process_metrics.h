// What a service says of its own process, at the address of its `--admin`.
#pragma once

#include <map>
#include <string>

namespace teletact::bench {

// Of /metrics, as tests/operation/metrics.h names them. `admin`: 127.0.0.1:PORT or unix:/path. Throws
// BenchError, which names --admin, when no metrics come from there within 30 s.
std::map<std::string, double> process_metrics(const std::string& admin);

}  // namespace teletact::bench
