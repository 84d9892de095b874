// By which name a request means this machine. A page of another site whose name leads here says that name.
#pragma once

#include <boost/beast/http/fields.hpp>
#include <boost/beast/http/message.hpp>
#include <optional>

namespace teletact {

struct HostRefusal {
  unsigned status;
  const char* words;
};

// Null: it names this machine's loopback, once; or nobody in HTTP/1.0, as probes do. Two names are refused
// whatever they are: whoever stands between may have looked at the other one.
std::optional<HostRefusal> host_refusal(const boost::beast::http::request_header<>& request);

}  // namespace teletact
