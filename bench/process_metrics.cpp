#include "bench/process_metrics.h"

#include <fmt/format.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <chrono>
#include <cstdlib>
#include <istream>

#include "bench/suite.h"

namespace teletact::bench {
namespace {

constexpr auto kPatience = std::chrono::seconds(30);

template <class Stream>
std::map<std::string, double> read(Stream stream, const std::string& admin) {
  stream.expires_after(kPatience);
  stream << "GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n" << std::flush;
  std::string line;
  if (!std::getline(stream, line) || !line.starts_with("HTTP/1.1 200"))
    throw BenchError(
        fmt::format("--admin {}: no metrics there; give the --admin address of teletact-service", admin));
  std::map<std::string, double> out;
  while (std::getline(stream, line)) {
    const std::size_t space = line.find(' ');
    if (space == std::string::npos || line[0] == '#' || line.find('{') < space || line.find(':') < space)
      continue;
    char* end = nullptr;
    const double value = std::strtod(line.c_str() + space, &end);
    if (end != line.c_str() + space) out[line.substr(0, space)] = value;
  }
  return out;
}

}  // namespace

std::map<std::string, double> process_metrics(const std::string& admin) {
  namespace asio = boost::asio;
  if (admin.starts_with("unix:"))
    return read(
        asio::local::stream_protocol::iostream(asio::local::stream_protocol::endpoint(admin.substr(5))),
        admin);
  const std::size_t colon = admin.rfind(':');
  if (colon == std::string::npos)
    throw BenchError(fmt::format("--admin {}: 127.0.0.1:PORT or unix:/path", admin));
  return read(asio::ip::tcp::iostream(admin.substr(0, colon), admin.substr(colon + 1)), admin);
}

}  // namespace teletact::bench
