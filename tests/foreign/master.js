/**
 * The `canopen` package of npm as master of one simulated joint drive.
 *
 *     node master.js PORT NODE EDS
 *
 * Prints one JSON object with what it saw; everything is judged by whoever started it.
 */

const { Device, DataType, Eds, NmtState } = require('canopen');
const { connect } = require('./socketcand.js');

const [port, node, edsFile] = [Number(process.argv[2]), Number(process.argv[3]), process.argv[4]];
const SYNC = 0x80;
const PERIOD_MS = 40; // busy machines hold a process up for longer than 20
const seen = { boots: 0, heartbeats: 0, emergencies: [], aborts: {}, states: [] };

const state = (word) => (word & 0x4f) === 0x40 ? 'switch on disabled' : {
    0x21: 'ready to switch on', 0x23: 'switched on', 0x27: 'operation enabled', 0x07: 'quick stop active',
    0x0f: 'fault reaction active',
}[word & 0x6f] || ((word & 0x4f) === 0x08 ? 'fault' : 'not ready to switch on');

async function main() {
    const device = new Device({ id: 0x7e });
    let feedback = null;
    const bus = await connect(port, (frame) => {
        if (frame.id === SYNC) // heard when it was sent
            return;
        if (frame.id === 0x700 + node)
            frame.data[0] === 0 ? seen.boots++ : seen.heartbeats++;
        if (frame.id === 0x180 + node) {
            feedback = { word: frame.data.readUInt16LE(0), position: frame.data.readInt32LE(2) };
            const now = state(feedback.word);
            if (seen.states.at(-1) !== now)
                seen.states.push(now);
        }
        device.receive(frame);
    });
    device.addListener('message', (message) => {
        bus.send(message);
        if (message.id === SYNC) // the package sends set points when it hears a SYNC: its own at once, not an echo that may be late
            device.receive(message);
    });
    device.emcy.on('emergency', (message) => seen.emergencies.push(message.em ? message.em.code : message.code));

    const { eds } = device;
    eds.addSdoClientParameter(node, 0x600 + node, 0x580 + node);
    eds.addEmcyConsumer(0x80 + node);
    eds.addHeartbeatConsumer(node, 2000);
    const controlword = eds.addEntry(0x2001, { parameterName: 'Controlword', dataType: DataType.UNSIGNED16 });
    const target = eds.addEntry(0x2002, { parameterName: 'Target position', dataType: DataType.INTEGER32 });
    const offset = eds.addEntry(0x2003, { parameterName: 'Torque offset', dataType: DataType.INTEGER16 });
    eds.addTransmitPdo({ cobId: 0x200 + node, transmissionType: 1, dataObjects: [controlword, target, offset] });
    eds.setSyncCobId(0x80);
    eds.setSyncCyclePeriod(PERIOD_MS * 1000);
    eds.setSyncGenerationEnable(true);
    device.start();

    const upload = (index, dataType, subIndex = 0) => device.sdo.upload({ serverId: node, index, subIndex, dataType, timeout: 5000 });
    const download = (index, data, dataType, subIndex = 0) =>
        device.sdo.download({ serverId: node, index, subIndex, data, dataType, timeout: 5000 });
    const abort = async(name, transfer) => {
        seen.aborts[name] = await transfer.then(() => 'accepted', (error) => error.code);
    };

    const drawing = Eds.fromFile(edsFile);
    seen.profile = await upload(0x1000, DataType.UNSIGNED32) & 0xffff;
    seen.name = await upload(0x1008, DataType.VISIBLE_STRING);
    seen.nameInEds = drawing.getEntry(0x1008).value;
    seen.entriesInEds = [...drawing.keys()].length;
    await abort('write to a constant', download(0x1000, 1, DataType.UNSIGNED32));
    await abort('object that is not there', upload(0x5fff, DataType.UNSIGNED32));
    await abort('sub-index that is not there', upload(0x1018, DataType.UNSIGNED32, 9));
    await abort('mode that is not supported', download(0x6060, 3, DataType.INTEGER8));
    await abort('wrong length', download(0x6065, 1, DataType.UNSIGNED8));

    await download(0x60c2, PERIOD_MS, DataType.UNSIGNED8, 1);
    await download(0x1017, 50, DataType.UNSIGNED16);
    await download(0x6060, 8, DataType.INTEGER8);
    const start = await upload(0x6064, DataType.INTEGER32);
    device.setValue(0x2002, start);
    device.nmt.startNode();
    device.nmt.startNode(node);

    const until = (what, condition) => new Promise((resolve, reject) => {
        const deadline = Date.now() + 20000;
        const look = () => feedback && condition(feedback) ? resolve()
            : Date.now() > deadline ? reject(new Error(`not within 20 s: ${what}; ${JSON.stringify(seen)}`))
                : setTimeout(look, 5);
        look();
    });
    const command = async(word, wanted) => {
        device.setValue(0x2001, word);
        await until(wanted, ({ word: status }) => state(status) === wanted);
    };
    await command(0x0006, 'ready to switch on');
    await command(0x0007, 'switched on');
    await command(0x000f, 'operation enabled');
    seen.nmtState = await device.nmt.getNodeState(node, 1000) === NmtState.OPERATIONAL ? 'operational' : 'other';

    const way = 100000; // 0.1 rad
    for (let i = 1; i <= 50; i++) {
        device.setValue(0x2002, start + way * i / 50);
        const before = feedback;
        await until('next feedback', (now) => now !== before);
    }
    await until('target', ({ position }) => Math.abs(position - start - way) < 500);
    seen.moved = feedback.position - start;

    await command(0x0002, 'switch on disabled'); // quick stop, option 2: down the ramp, then off
    device.nmt.stopNode(node);
    device.stop();
    bus.close();
    console.log(JSON.stringify(seen));
}

main().then(() => process.exit(0), (error) => {
    console.error(error.stack || error);
    process.exit(1);
});
