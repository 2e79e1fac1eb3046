import"./chunk-QM3DQEVC.js";import{O as e,y as t}from"./chunk-IZNNYOB3.js";function o(){return t(e,{title:"Reconstruct",text:"This page is being built."})}export{o as Reconstruct};
