// What Rust calls of libudt, without exceptions and with plain types.
//
// Every function returns -1 on failure and then fills `error`. Addresses are IPv4 in host order.

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <udt/udt.h>

#include <cstdint>
#include <cstring>
#include <exception>

extern "C" {

struct fipa_udt_error {
    int code;
    char text[200];
};

}

namespace {

const int BACKLOG = 64;

int fail(fipa_udt_error* error) {
    error->code = UDT::getlasterror().getErrorCode();
    std::strncpy(error->text, UDT::getlasterror().getErrorMessage(), sizeof error->text - 1);
    error->text[sizeof error->text - 1] = '\0';
    return -1;
}

int fail(fipa_udt_error* error, const char* text) {
    error->code = 0;
    std::strncpy(error->text, text, sizeof error->text - 1);
    error->text[sizeof error->text - 1] = '\0';
    return -1;
}

// Nothing thrown may reach Rust.
template <typename Call>
int guarded(fipa_udt_error* error, Call call) {
    try {
        return call();
    } catch (const std::exception& thrown) {
        return fail(error, thrown.what());
    } catch (...) {
        return fail(error, "libudt threw something unknown");
    }
}

sockaddr_in address(uint32_t ip, uint16_t port) {
    sockaddr_in address;
    std::memset(&address, 0, sizeof address);
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(ip);
    address.sin_port = htons(port);
    return address;
}

// A socket for whole messages, with buffers for one of `buffer` octets.
UDTSOCKET open(int buffer) {
    UDTSOCKET socket = UDT::socket(AF_INET, SOCK_DGRAM, 0);
    if (socket == UDT::INVALID_SOCK) {
        return socket;
    }
    if (UDT::setsockopt(socket, 0, UDT_RCVBUF, &buffer, sizeof buffer) == UDT::ERROR ||
        UDT::setsockopt(socket, 0, UDT_SNDBUF, &buffer, sizeof buffer) == UDT::ERROR) {
        UDT::close(socket);
        return UDT::INVALID_SOCK;
    }
    return socket;
}

int timeout(UDTSOCKET socket, UDTOpt option, int milliseconds) {
    return UDT::setsockopt(socket, 0, option, &milliseconds, sizeof milliseconds);
}

const int NOTHING = -2;

// The octets of a message, NOTHING or UDT::ERROR; 0 milliseconds: without waiting.
int receive(UDTSOCKET socket, char* octets, int capacity, int milliseconds) {
    bool blocking = milliseconds > 0;
    if (UDT::setsockopt(socket, 0, UDT_RCVSYN, &blocking, sizeof blocking) == UDT::ERROR ||
        timeout(socket, UDT_RCVTIMEO, milliseconds) == UDT::ERROR) {
        return UDT::ERROR;
    }
    int count = UDT::recvmsg(socket, octets, capacity);
    if (count != UDT::ERROR) {
        return count;
    }
    int code = UDT::getlasterror().getErrorCode();
    bool none = code == CUDTException::ETIMEOUT || code == CUDTException::EASYNCRCV;
    return none ? NOTHING : UDT::ERROR;
}

}

extern "C" {

int fipa_udt_listen(uint32_t ip, uint16_t port, int buffer, fipa_udt_error* error) {
    return guarded(error, [=] {
        UDTSOCKET socket = open(buffer);
        if (socket == UDT::INVALID_SOCK) {
            return fail(error);
        }
        sockaddr_in local = address(ip, port);
        if (UDT::bind(socket, reinterpret_cast<sockaddr*>(&local), sizeof local) == UDT::ERROR ||
            UDT::listen(socket, BACKLOG) == UDT::ERROR) {
            fail(error);
            UDT::close(socket);
            return -1;
        }
        // accept() is asked only after a wait, and then does not block.
        bool blocking = false;
        UDT::setsockopt(socket, 0, UDT_RCVSYN, &blocking, sizeof blocking);
        return socket;
    });
}

int fipa_udt_local_port(int socket, fipa_udt_error* error) {
    return guarded(error, [=] {
        sockaddr_in local;
        int length = sizeof local;
        if (UDT::getsockname(socket, reinterpret_cast<sockaddr*>(&local), &length) == UDT::ERROR) {
            return fail(error);
        }
        return static_cast<int>(ntohs(local.sin_port));
    });
}

int fipa_udt_peer(int socket, uint32_t* ip, uint16_t* port, fipa_udt_error* error) {
    return guarded(error, [=] {
        sockaddr_in peer;
        int length = sizeof peer;
        if (UDT::getpeername(socket, reinterpret_cast<sockaddr*>(&peer), &length) == UDT::ERROR) {
            return fail(error);
        }
        *ip = ntohl(peer.sin_addr.s_addr);
        *port = ntohs(peer.sin_port);
        return 0;
    });
}

// The accepted socket, or 0 if nobody called.
int fipa_udt_accept(int listener, int milliseconds, fipa_udt_error* error) {
    return guarded(error, [=] {
        UDT::UDSET ready;
        UD_ZERO(&ready);
        UD_SET(listener, &ready);
        timeval wait;
        wait.tv_sec = milliseconds / 1000;
        wait.tv_usec = milliseconds % 1000 * 1000;
        int count = UDT::select(listener + 1, &ready, NULL, NULL, &wait);
        if (count == UDT::ERROR) {
            return fail(error);
        }
        if (count == 0) {
            return 0;
        }
        sockaddr_in peer;
        int length = sizeof peer;
        UDTSOCKET socket = UDT::accept(listener, reinterpret_cast<sockaddr*>(&peer), &length);
        if (socket == UDT::INVALID_SOCK) {
            return UDT::getlasterror().getErrorCode() == CUDTException::EASYNCRCV ? 0 : fail(error);
        }
        return socket;
    });
}

int fipa_udt_connect(uint32_t ip, uint16_t port, int buffer, fipa_udt_error* error) {
    return guarded(error, [=] {
        UDTSOCKET socket = open(buffer);
        if (socket == UDT::INVALID_SOCK) {
            return fail(error);
        }
        sockaddr_in peer = address(ip, port);
        if (UDT::connect(socket, reinterpret_cast<sockaddr*>(&peer), sizeof peer) == UDT::ERROR) {
            fail(error);
            UDT::close(socket);
            return -1;
        }
        return socket;
    });
}

// The octets sent: all of them.
int fipa_udt_send(int socket, const char* octets, int count, int milliseconds,
                  fipa_udt_error* error) {
    return guarded(error, [=] {
        if (timeout(socket, UDT_SNDTIMEO, milliseconds) == UDT::ERROR) {
            return fail(error);
        }
        // For ever, and in order, as fipa_services does.
        int sent = UDT::sendmsg(socket, octets, count, -1, true);
        if (sent == UDT::ERROR) {
            return fail(error);
        }
        return sent == count ? sent : fail(error, "the message was not taken in time");
    });
}

// The packets that the other side has not confirmed yet.
int fipa_udt_unconfirmed(int socket, fipa_udt_error* error) {
    return guarded(error, [=] {
        int count = 0;
        int length = sizeof count;
        if (UDT::getsockopt(socket, 0, UDT_SNDDATA, &count, &length) == UDT::ERROR) {
            return fail(error);
        }
        return count;
    });
}

// The octets of the next message, or 0 if none came.
//
// A receive with a time-out waits first and looks then: it sleeps over a message that is there
// already. So it is asked without waiting first, and then waits in slices, which bound how long one
// that comes in between is slept over.
int fipa_udt_receive(int socket, char* octets, int capacity, int milliseconds,
                     fipa_udt_error* error) {
    return guarded(error, [=] {
        const int SLICE = 20;
        int left = milliseconds;
        for (;;) {
            int count = receive(socket, octets, capacity, 0);
            if (count == NOTHING && left > 0) {
                int slice = left < SLICE ? left : SLICE;
                left -= slice;
                count = receive(socket, octets, capacity, slice);
            }
            if (count == UDT::ERROR) {
                return fail(error);
            }
            if (count != NOTHING) {
                return count;
            }
            if (left <= 0) {
                return 0;
            }
        }
    });
}

void fipa_udt_close(int socket) {
    fipa_udt_error ignored;
    guarded(&ignored, [=] { return UDT::close(socket); });
}

}
