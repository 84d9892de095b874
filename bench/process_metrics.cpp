#include "bench/process_metrics.h"

#include <fmt/format.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/local/stream_protocol.hpp>
#include <chrono>
#include <istream>
#include <iterator>

#include "bench/suite.h"
#include "tests/operation/metrics.h"

namespace teletact::bench {
namespace {

namespace asio = boost::asio;

constexpr auto kPatience = std::chrono::seconds(30);

template <class Stream>
std::string answer(Stream stream) {
  stream.expires_after(kPatience);
  stream << "GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n" << std::flush;
  return {std::istreambuf_iterator<char>(stream), {}};
}

}  // namespace

std::map<std::string, double> process_metrics(const std::string& admin) {
  const std::size_t colon = admin.rfind(':');
  if (colon == std::string::npos)
    throw BenchError(fmt::format("--admin {}: 127.0.0.1:PORT or unix:/path", admin));
  const std::string text =
      admin.starts_with("unix:")
          ? answer(asio::local::stream_protocol::iostream(
                asio::local::stream_protocol::endpoint(admin.substr(5))))
          : answer(asio::ip::tcp::iostream(admin.substr(0, colon), admin.substr(colon + 1)));
  if (!text.starts_with("HTTP/1.1 200"))
    throw BenchError(
        fmt::format("--admin {}: no metrics there; give the --admin address of teletact-service", admin));
  return test::metrics_of(text.substr(text.find("\r\n\r\n") + 4));
}

}  // namespace teletact::bench
