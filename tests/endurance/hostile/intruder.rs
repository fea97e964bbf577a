//! A program that opens the topics of a ring without the lock of a role.

use std::fmt::Debug;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use skysink_common::possible::Message;
use skysink_ring::folder::RingFolder;
use skysink_ring::sample::{Header, Payload};

pub struct Intruder(Node<ipc::Service>);

impl Intruder {
    pub fn join(folder: &RingFolder) -> Self {
        let node = NodeBuilder::new().config(&folder.config().unwrap());
        Self(node.signal_handling_mode(SignalHandlingMode::Disabled).create().unwrap())
    }

    fn topic<P: Payload + ?Sized, H: Header>(&self, topic: &str) -> PortFactory<ipc::Service, P, H> {
        let name = ServiceName::new(&format!("skysink/{topic}")).unwrap();
        P::service(self.0.service_builder(&name).publish_subscribe::<P>().user_header::<H>(), None).unwrap()
    }

    /// A writer that does not wait for readers.
    pub fn writer<P: Message + Debug + Copy + ZeroCopySend + 'static, H: Header>(
        &self,
        topic: &str,
    ) -> Publisher<ipc::Service, P, H> {
        let service = self.topic::<P, H>(topic);
        let writer = service.publisher_builder();
        writer.backpressure_strategy(BackpressureStrategy::DiscardData).create().unwrap()
    }

    /// The same for lists of up to `len`.
    pub fn list_writer<T: Message + Debug + Copy + ZeroCopySend + 'static, H: Header>(
        &self,
        topic: &str,
        len: usize,
    ) -> Publisher<ipc::Service, [T], H> {
        let service = self.topic::<[T], H>(topic);
        let writer = service.publisher_builder().initial_max_slice_len(len);
        writer.backpressure_strategy(BackpressureStrategy::DiscardData).create().unwrap()
    }

    /// A reader with room for one sample, which it need not take.
    pub fn reader<P: Payload + ?Sized, H: Header>(&self, topic: &str) -> Subscriber<ipc::Service, P, H> {
        self.topic(topic).subscriber_builder().buffer_size(1).create().unwrap()
    }

    /// The same with the port name `observer`: no writer waits for it.
    pub fn observer<P: Payload + ?Sized, H: Header>(&self, topic: &str) -> Subscriber<ipc::Service, P, H> {
        let name = "observer".try_into().unwrap();
        self.topic(topic).subscriber_builder().name(&name).buffer_size(1).create().unwrap()
    }
}

/// Sends without a wake-up.
pub fn send<P: Debug + Copy + ZeroCopySend, H: Header>(writer: &Publisher<ipc::Service, P, H>, header: H, message: P) {
    let mut sample = writer.loan_uninit().unwrap();
    *sample.user_header_mut() = header;
    sample.write_payload(message).send().unwrap();
}

/// The same for a list.
pub fn send_list<T: Debug + Copy + ZeroCopySend, H: Header>(
    writer: &Publisher<ipc::Service, [T], H>,
    header: H,
    list: &[T],
) {
    let mut sample = writer.loan_slice_uninit(list.len()).unwrap();
    *sample.user_header_mut() = header;
    sample.write_from_slice(list).send().unwrap();
}
