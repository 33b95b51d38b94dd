/** A bus as `socketcand` serves it in raw mode, for the `canopen` package: frames out by `send`, frames in by `onFrame`. */

const net = require('net');

function connect(port, onFrame) {
    return new Promise((resolve, reject) => {
        const socket = net.createConnection(port, '127.0.0.1');
        let text = '', waiting = ['hi', 'ok', 'ok'];
        const requests = ['< open can0 >', '< rawmode >'];
        socket.setNoDelay(true);
        socket.on('error', reject);
        socket.on('data', (chunk) => {
            text += chunk.toString('latin1');
            for (let end = text.indexOf('>'); end >= 0; end = text.indexOf('>')) {
                const words = text.slice(text.indexOf('<') + 1, end).trim().split(/\s+/);
                text = text.slice(end + 1);
                if (words[0] === 'frame') {
                    const data = Buffer.from(words.slice(3).join(''), 'hex');
                    onFrame({ id: parseInt(words[1], 16), data, len: data.length });
                }
                else if (words[0] === waiting[0]) {
                    waiting.shift();
                    if (requests.length)
                        socket.write(requests.shift());
                    else
                        resolve({
                            send: ({ id, data }) => {
                                const bytes = [...(data || [])].map((b) => b.toString(16).padStart(2, '0'));
                                socket.write(`< send ${id.toString(16)} ${[bytes.length, ...bytes].join(' ')} >`);
                            },
                            close: () => socket.end(),
                        });
                }
                else if (words[0] === 'error')
                    reject(new Error(`socketcand: ${words.join(' ')}`));
            }
        });
    });
}

module.exports = { connect };
