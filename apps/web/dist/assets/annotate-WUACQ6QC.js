import"./chunk-QM3DQEVC.js";import{O as e,y as t}from"./chunk-IZNNYOB3.js";function i(){return t(e,{title:"Annotate",text:"This page is being built."})}export{i as Annotate};
