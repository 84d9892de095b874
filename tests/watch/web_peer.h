// A viewer of the page, or what says that it is one.
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
#include <cstdint>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

namespace teletact::test {

// Of "http://127.0.0.1:PORT/TOKEN/".
inline unsigned port_of_url(const std::string& url) {
  return static_cast<unsigned>(std::stoul(url.substr(url.find(':', 7) + 1)));
}
inline std::string path_of_url(const std::string& url) {
  return url.substr(url.find('/', 8));
}

struct WebSlot {
  nlohmann::json json;
  std::string data;
};
struct WebFrame {
  std::uint32_t number = 0;
  std::map<std::uint32_t, WebSlot> slots;
};

inline std::uint32_t word_at(const std::string& bytes, std::size_t at) {
  std::uint32_t word = 0;
  std::memcpy(&word, bytes.data() + at, sizeof(word));
  return word;
}

inline WebFrame decoded(const std::string& bytes) {
  constexpr std::uint32_t kMagic = 0x544c5454;
  const auto padded = [](std::size_t size) { return (size + 7) / 8 * 8; };
  if (bytes.size() < 16 || word_at(bytes, 0) != kMagic) throw std::runtime_error("no frame");
  WebFrame out{word_at(bytes, 4), {}};
  std::size_t at = 16;
  for (std::uint32_t n = 0; n < word_at(bytes, 8); ++n) {
    const std::uint32_t json = word_at(bytes, at + 4), data = word_at(bytes, at + 8);
    const std::size_t json_at = at + 16, data_at = json_at + padded(json);
    out.slots[word_at(bytes, at)] = {nlohmann::json::parse(bytes.substr(json_at, json)),
                                     bytes.substr(data_at, data)};
    at = data_at + padded(data);
  }
  if (at != bytes.size()) throw std::runtime_error("not a whole frame");
  return out;
}

class WebPeer {
 public:
  // Throws boost::system::system_error when it is not let in.
  WebPeer(const std::string& url, const std::string& path, const std::string& origin) {
    const std::string host = "127.0.0.1:" + std::to_string(port_of_url(url));
    stream_.next_layer().connect(
        {boost::asio::ip::make_address("127.0.0.1"), static_cast<std::uint16_t>(port_of_url(url))});
    stream_.set_option(boost::beast::websocket::stream_base::decorator([origin](auto& request) {
      if (!origin.empty()) request.set(boost::beast::http::field::origin, origin);
    }));
    stream_.handshake(host, path);
  }
  explicit WebPeer(const std::string& url)
      : WebPeer(url, path_of_url(url) + "live", url.substr(0, url.find('/', 8))) {}

  WebFrame read() {
    boost::beast::flat_buffer buffer;
    stream_.read(buffer);
    return decoded(boost::beast::buffers_to_string(buffer.data()));
  }
  void say(const std::string& text) { stream_.write(boost::asio::buffer(text)); }
  void painted(std::uint32_t number) { say("{\"painted\":" + std::to_string(number) + "}"); }
  // Bytes that wait to be read.
  std::size_t waiting() { return stream_.next_layer().available(); }

 private:
  boost::asio::io_context io_;
  boost::beast::websocket::stream<boost::asio::ip::tcp::socket> stream_{io_};
};

}  // namespace teletact::test
